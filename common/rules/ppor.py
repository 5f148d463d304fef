"""Settings of the rule `ppor`."""

from typing import Self

from pydantic import Field, model_validator

from railctl.common.rules.policies import ActorCriticConfig, PolicySettings, PpoConfig
from railctl.common.rules.replay import UniformReplay, check_batch


class ReplayedPpoConfig(PpoConfig):
    """As `PpoConfig`, on batches drawn from a replay."""

    batch_size: int = Field(ge=1, le=65536)


class Settings(PolicySettings):
    """Proximal policy optimisation on batches of many episodes."""

    network: ActorCriticConfig = ActorCriticConfig()
    ppo: ReplayedPpoConfig
    replay: UniformReplay

    @model_validator(mode="after")
    def _batches_fit_in_replay(self) -> Self:
        check_batch("ppo.batch_size", self.ppo.batch_size, self.replay)
        return self
