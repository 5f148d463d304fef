"""Settings of the rule `drqn`."""

from typing import Literal, Self

from pydantic import Field, model_validator

from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.values import DqnConfig, ValueSettings


class RecurrentConfig(NetworkConfig):
    """An LSTM, the first of the widths, then as a dueling network."""

    kind: Literal["recurrent"] = "recurrent"


class RecurrentDqnConfig(DqnConfig):
    """As `DqnConfig`, over sequences (Hausknecht & Stone 2015)."""

    sequence_decisions: int = Field(default=8, ge=1, le=1000)  # of a train, the last of which is learned from


class Settings(ValueSettings):
    """Deep recurrent Q-learning."""

    network: RecurrentConfig = RecurrentConfig()
    dqn: RecurrentDqnConfig

    @model_validator(mode="after")
    def _sequences_are_of_decisions(self) -> Self:
        if self.dqn.transitions == "step":
            raise ValueError("dqn.transitions step: the sequences of drqn lead from decision to decision, make it span")
        return self
