"""Settings of the rule `imitate`."""

from typing import Self

from pydantic import Field, model_validator

from railctl.common.rules.policies import ActorCriticConfig, ActorCriticSettings
from railctl.common.rules.replay import UniformReplay, check_batch
from railctl.common.strict import Positive, Share, Strict


class TeacherConfig(Strict):
    """The planner that says what it would do (`common.rail.planning.judging`), and how many decisions it makes."""

    orders: int = Field(default=10, ge=1, le=1000)  # of trains that are tried for each action; the best plan counts
    margin: int = Field(default=4, ge=1, le=1000)  # steps, of all trains, by which it has to beat the shortest way
    patience: int = Field(default=16, ge=1, le=100_000)  # steps after which a train that stands should go if it may
    share: float = Field(default=1.0, ge=0, le=1)  # of the decisions of the first episode, falling evenly to none
    decay_share: Share = 0.1  # of the episodes, in which it falls


class ImitationConfig(Strict):
    """Imitation of what the teacher would do, in the states that teacher and policy come to (Ross et al. 2011)."""

    learning_rate: Positive  # falls evenly to a hundredth of it
    updates: int = Field(ge=1, le=1000)  # an episode
    batch_size: int = Field(ge=1, le=65536)
    value_weight: float = Field(default=0.5, ge=0, allow_inf_nan=False)
    max_gradient_norm: Positive = 0.5


class Settings(ActorCriticSettings):
    """Imitation of a planner, on all decisions so far."""

    network: ActorCriticConfig = ActorCriticConfig()
    teacher: TeacherConfig = TeacherConfig()
    imitation: ImitationConfig
    replay: UniformReplay

    @model_validator(mode="after")
    def _batches_fit_in_replay(self) -> Self:
        check_batch("imitation.batch_size", self.imitation.batch_size, self.replay)
        return self

    @property
    def teaching(self) -> tuple[int, int, int]:
        return self.teacher.orders, self.teacher.margin, self.teacher.patience

    def epsilon(self, episode: int, episodes: int) -> float:
        """The share of decisions that are the teacher's in `episode` (0-based) of a run of `episodes`."""
        progress = min(1.0, episode / max(1.0, episodes * self.teacher.decay_share))
        return self.teacher.share * (1 - progress)
