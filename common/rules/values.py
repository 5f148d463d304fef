"""What rules share that learn action values: replay, exploration, and learning within an episode."""

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from railctl.common.rules.replay import AnyReplay, check_batch
from railctl.common.rules.settings import RuleSettings
from railctl.common.strict import Positive, Share, Strict


class DqnConfig(Strict):
    """Deep Q-learning and its variants (Mnih et al. 2015)."""

    learning_rate: Positive
    batch_size: int = Field(ge=1, le=65536)
    learn_every_steps: int = Field(ge=1)  # environment steps between two updates
    target_tau: Share | None = None  # share of the online network that the target takes at a time; None: no target
    target_every: Literal["update", "episode"] = "update"  # after each, or at its end
    # The online network picks, the target network scores (van Hasselt et al. 2016), or the other way round:
    double: Literal[False, True, "reversed"] = False
    # From a train's decision to its next one, or, as the study writes it, to the next step, whether it decides there:
    transitions: Literal["span", "step"] = "span"

    @model_validator(mode="after")
    def _what_needs_a_target_has_one(self) -> Self:
        if self.target_tau is None:
            if self.double:
                raise ValueError("double needs a target network: set target_tau")
            if self.target_every == "episode":
                raise ValueError("target_every episode needs a target network: set target_tau")
        return self

    @property
    def share_an_update(self) -> float:
        """What the target network takes of the online one after each update; 0: nothing."""
        return (self.target_tau or 0) if self.target_every == "update" else 0

    @property
    def share_an_episode(self) -> float:
        """What it takes at the end of each episode."""
        return (self.target_tau or 0) if self.target_every == "episode" else 0


class ExplorationConfig(Strict):
    """Epsilon-greedy: epsilon falls geometrically over `decay_share` of the episodes."""

    epsilon_start: float = Field(default=0.9, ge=0, le=1)
    epsilon_end: float = Field(default=0.01, gt=0, le=1)
    decay_share: Share = 0.5

    def epsilon(self, episode: int, episodes: int) -> float:
        """The share of random actions in `episode` (0-based) of a run of `episodes`."""
        if self.epsilon_start <= self.epsilon_end:
            return self.epsilon_start
        progress = min(1.0, episode / max(1.0, episodes * self.decay_share))
        # Rounded, as the last bit of a power differs from one kind of processor to another.
        return round(float(self.epsilon_start * (self.epsilon_end / self.epsilon_start) ** progress), 9)


class ValueSettings(RuleSettings):
    """The settings of a rule that learns action values from a replay."""

    dqn: DqnConfig
    replay: AnyReplay
    exploration: ExplorationConfig = ExplorationConfig()
    # Acted with the same weights; None: whole episodes:
    fragment_steps: int | None = Field(default=None, ge=1, le=100_000)

    @model_validator(mode="after")
    def _batches_fit_in_replay(self) -> Self:
        check_batch("dqn.batch_size", self.dqn.batch_size, self.replay)
        return self

    @property
    def steps_a_fragment(self) -> int | None:
        return self.fragment_steps

    @property
    def learns_from_following(self) -> bool:
        return self.dqn.transitions == "step"

    def epsilon(self, episode: int, episodes: int) -> float:
        return self.exploration.epsilon(episode, episodes)

    @classmethod
    def adapted(cls, preset: Mapping[str, Any], lag: int | str) -> dict[str, Any]:
        """Several episodes at a time are whole ones."""
        return {key: value for key, value in preset.items() if not (lag and key == "fragment_steps")}
