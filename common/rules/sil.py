"""Settings of the rule `sil`."""

from typing import Literal, Self

from pydantic import Field, model_validator

from railctl.common.rules.policies import ActorCriticConfig, PolicySettings
from railctl.common.rules.replay import PrioritizedReplay, check_batch
from railctl.common.rules.settings import Demonstrations
from railctl.common.strict import Strict


class SilConfig(Strict):
    """Self-imitation learning (Oh et al. 2018), after the updates of `PpoConfig` and with its learning rate.

    Attributes:
        returns: what decisions turned out to be worth. `least`, ours: trains that the step limit stops never arrive;
            `bootstrapped`: the critic says what follows, as for `ppo`'s updates (the study's Algorithm 4 has one R).
    """

    epochs: int = Field(ge=1, le=1000)  # updates an episode
    batch_size: int = Field(ge=1, le=65536)
    value_weight: float = Field(default=0.01, ge=0, allow_inf_nan=False)
    returns: Literal["least", "bootstrapped"] = "least"


class Settings(PolicySettings):
    """Self-imitation learning."""

    network: ActorCriticConfig = ActorCriticConfig()
    sil: SilConfig
    replay: PrioritizedReplay
    demonstrations: Demonstrations | None = None

    @model_validator(mode="after")
    def _replay_fits(self) -> Self:
        check_batch("sil.batch_size", self.sil.batch_size, self.replay)
        if self.replay.beta != 0:
            raise ValueError(
                f"replay.beta {self.replay.beta:g}: self-imitation is to favour what turned out well, make it 0"
            )
        return self

    @property
    def demonstrated(self) -> Demonstrations | None:
        return self.demonstrations

    @property
    def room_for_demonstrations(self) -> int:
        return self.replay.capacity
