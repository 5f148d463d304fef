"""Settings of the rule `dqn`: `dqn`, `ddqn` and `dddqn` are presets of it."""

from typing import Literal

from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.values import ValueSettings


class QNetworkConfig(NetworkConfig):
    """Hidden layers, then action values, or a value and advantages (Wang et al. 2016).

    Of `dueling-apart` value and advantages have hidden layers each, as in section 4.2 of the study.
    """

    kind: Literal["plain", "dueling", "dueling-apart"] = "plain"


class Settings(ValueSettings):
    """Deep Q-learning."""

    network: QNetworkConfig = QNetworkConfig()
