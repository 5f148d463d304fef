"""Decisions to learn a policy from, and a replay of them."""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from railctl.common.rules.replay import ReplayConfig
from railctl.common.seeding import stream_key
from railctl.services.learner.former import with_all_allowed
from railctl.services.learner.replay.replay import Replay
from railctl.services.learner.sparse import Observations, dense_rows

ROWS = ("observation_tm1",)
DRAWS = "draws"  # the name of their number in a state
EPISODES = "episodes"


class Experience(NamedTuple):
    """B decisions; values and returns are scaled (`services.learner.returns`).

    With each stands what a replay keeps it as.
    """

    observation_tm1: Annotated[Observations, np.float32]  # [B, F]
    action_tm1: Annotated[NDArray[np.int64], np.int8]  # [B]
    allowed_tm1: Annotated[NDArray[np.int64], np.uint8]  # [B], what there was to choose from, a bit for each action
    return_t: Annotated[NDArray[np.float32], np.float32]  # [B]
    least_return_t: Annotated[
        NDArray[np.float32], np.float32
    ]  # [B], if trains that the step limit stopped never arrive
    log_probability_tm1: Annotated[NDArray[np.float32], np.float32]  # [B], of the action when it was chosen
    value_tm1: Annotated[NDArray[np.float32], np.float32]  # [B], the critic's when the action was chosen


KEPT_AS = {name: hint.__metadata__[0] for name, hint in get_type_hints(Experience, include_extras=True).items()}
COLUMNS = {name: dtype for name, dtype in KEPT_AS.items() if name not in ROWS}


class Drawn(NamedTuple):
    """A batch from a replay, valid until the next one, and where its decisions lie in it."""

    experience: Experience
    places: NDArray[np.int64]


class ExperienceReplay:
    """The newest decisions of all episodes; batch `n` is drawn with a stream of its own."""

    def __init__(self, config: ReplayConfig, n_features: int, seed: int) -> None:
        self._replay = Replay(config, COLUMNS, ROWS, n_features)
        self._seed = seed
        self._draws = 0

    def __len__(self) -> int:
        return len(self._replay)

    def add(self, new: Experience, priorities: NDArray[np.float64] | None = None) -> None:
        """Append decisions, oldest first; `priorities` [B] are for a prioritised replay."""
        dense = new._replace(observation_tm1=dense_rows(new.observation_tm1))
        items = {name: getattr(dense, name).astype(dtype, copy=False) for name, dtype in KEPT_AS.items()}
        self._replay.add(items, priorities)

    def sample(self, size: int) -> Drawn:
        """A batch, with replacement. Weights of importance are left out: no rule of a policy asks for them."""
        key = stream_key(self._seed, self._draws, "replay")
        self._draws += 1
        sample = self._replay.sample(size, key, beta=0.0)
        return Drawn(Experience(sample.rows["observation_tm1"], **sample.columns), sample.places)

    def reprioritise(self, places: NDArray[np.int64], priorities: NDArray[np.float64]) -> None:
        """Give new priorities [B] to decisions at `places` [B]."""
        self._replay.reprioritise(places, priorities)

    def temper(self, progress: float) -> None:
        """Have priorities count as they do after a share of the run."""
        self._replay.temper(progress)

    def metrics(self) -> dict[str, float]:
        """How full it is, and what its priorities are."""
        return self._replay.metrics()

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything."""
        return self._replay.state() | {DRAWS: np.array(self._draws, np.int64)}

    def restore(self, state: Mapping[str, NDArray[Any]], progress: float = 0.0) -> None:
        """Take on a `state`, last tempered with `progress`; ValueError names the tensor that does not fit."""
        if DRAWS not in state:
            raise ValueError(f"tensor {DRAWS} is missing: this state is of another rule")
        kept = {name: array for name, array in state.items() if name != DRAWS}
        self._replay.restore(with_all_allowed(kept, "allowed_tm1"), progress)
        self._draws = int(state[DRAWS])


class WithReplay:
    """A rule that keeps nothing but a replay, besides its network."""

    def __init__(self, replay: ExperienceReplay) -> None:
        self._replay = replay

    def metrics(self) -> dict[str, float]:
        return self._replay.metrics()

    def state(self) -> dict[str, NDArray[Any]]:
        return self._replay.state()

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._replay.restore(state)


class Counting(WithReplay):
    """A rule that counts episodes, too, for something in it depends on how much of the run is over."""

    def __init__(self, replay: ExperienceReplay, episodes: int) -> None:
        """`episodes` are those of the run."""
        super().__init__(replay)
        self._of, self._episodes = episodes, 0

    @property
    def _progress(self) -> float:
        """Episodes so far, as a share of the run's."""
        return self._episodes / self._of

    def _count(self) -> None:
        """An episode is over."""
        self._episodes += 1
        self._replay.temper(self._progress)

    def state(self) -> dict[str, NDArray[Any]]:
        return super().state() | {EPISODES: np.array(self._episodes, np.int64)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._episodes = int(state.get(EPISODES, 0))
        self._replay.restore({name: array for name, array in state.items() if name != EPISODES}, self._progress)
