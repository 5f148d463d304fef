"""What the leases of a run say of each episode: a function of the configuration alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from railctl.common.config import RunConfig
from railctl.common.policy.player import n_state_of
from railctl.common.seeding import training_distribution, training_level_seed


@dataclass(frozen=True)
class Schedule:
    """What every episode is acted on, and how.

    Attributes:
        levels: the name of the level distribution, for each episode.
        level_seed: of an episode.
        epsilon: the share of random actions in an episode; 0 for policies, which explore by what they are.
        trains: how many a level has at most, by the name of its distribution.
        lag: how many episodes more than one may be under way at a time.
        free: they act with the newest weights, and not with those that the lag names.
        fragment_steps: leases end where the steps of the run are multiples of it; None: they cover whole episodes.
        following: decisions are noted with what their trains see one step later.
        n_state: S, the numbers that a train carries along.
        unsaved: how many episodes may be trained and in no snapshot: a learner that goes on knows nothing of them.
    """

    levels: Sequence[str]
    level_seed: Callable[[int], int]
    epsilon: Callable[[int], float]
    trains: Mapping[str, int]
    lag: int = 0
    free: bool = False
    fragment_steps: int | None = None
    following: bool = False
    n_state: int = 0
    unsaved: int = 0

    @classmethod
    def of(cls, config: RunConfig) -> "Schedule":
        """The schedule of a run."""
        return cls(
            levels=drawn_levels({str(name): share for name, share in config.mix.items()}, config.episodes, config.seed),
            level_seed=partial(training_level_seed, config.seed),
            epsilon=partial(_epsilon, config),
            trains={name: levels.bounds.trains for name, levels in config.world.levels.items()},
            lag=config.most_ahead,
            free=config.is_free,
            fragment_steps=config.learning.steps_a_fragment,
            following=config.learning.learns_from_following,
            n_state=n_state_of(config),
            unsaved=config.cluster.snapshot_every_episodes,
        )


def _epsilon(config: RunConfig, episode: int) -> float:
    return config.learning.epsilon(episode, config.episodes)


def drawn_levels(mix: Mapping[str, float], episodes: int, seed: int) -> Sequence[str]:
    """The level distribution of each episode: drawn with the shares of `mix`."""
    return [training_distribution(mix, seed, episode) for episode in range(episodes)]
