"""Settings of the rule `dqn`: `dqn`, `ddqn` and `dddqn` are presets of it."""

from typing import Literal

from common.rules.settings import NetworkConfig
from common.rules.values import ValueSettings


class QNetworkConfig(NetworkConfig):
    """Hidden layers, then action values, or a value and advantages (Wang et al. 2016)."""

    kind: Literal["plain", "dueling"] = "plain"


class Settings(ValueSettings):
    """Deep Q-learning."""

    network: QNetworkConfig = QNetworkConfig()
