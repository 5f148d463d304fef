"""What happened in an episode, or in a fragment of one: what players give, learners take and wires carry."""

from collections import namedtuple
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from railctl.common.levels.level import MOST_STEPS
from railctl.common.records.base import Array, Digest, Record

NONE = -1  # not arrived; no advice


class Decisions(Record):
    """D decisions in the order of (time, train). A field here is all that a new number a decision needs on its way.

    Attributes:
        observations: [D, F].
        times: [D], steps since the start of the episode.
        trains: [D].
        actions: [D].
        allowed: [D], what there was to choose from, a bit for each action.
        log_probabilities: [D], of the actions; zero for networks of action values.
        values: [D], of what was observed; zero for networks of action values.
        labels: [D], what a teacher would have done, NONE if it knows nothing better, or there is none.
        following: [D, G], what their trains saw one step later, zeros once they have arrived; G is F where the run's
            rule learns from it, else 0.
    """

    observations: Annotated[NDArray[np.float32], Array("float32", ("D", "F"))]
    times: Annotated[NDArray[np.int32], Array("int32", ("D",))]
    trains: Annotated[NDArray[np.int32], Array("int32", ("D",))]
    actions: Annotated[NDArray[np.int8], Array("int8", ("D",))]
    allowed: Annotated[NDArray[np.uint8], Array("uint8", ("D",))]
    log_probabilities: Annotated[NDArray[np.float32], Array("float32", ("D",))]
    values: Annotated[NDArray[np.float32], Array("float32", ("D",))]
    labels: Annotated[NDArray[np.int8], Array("int8", ("D",))]
    following: Annotated[NDArray[np.float32], Array("float32", ("D", "G"))]

    def __len__(self) -> int:
        return len(self.times)

    def chosen(self, which: Any) -> "Decisions":
        """Those that a mask [D], a slice or an array of indices picks."""
        return Decisions(**{name: getattr(self, name)[which] for name in Decisions.model_fields})

    @classmethod
    def joined(cls, parts: Sequence["Decisions"]) -> "Decisions":
        """Those of all parts, one after the other; at least one."""
        if len(parts) == 1:
            return parts[0]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls.model_fields})


# The same columns as compiled code takes them: arrays without a model around them. No second list of names.
Columns: Any = namedtuple("Columns", tuple(Decisions.model_fields))  # type: ignore[misc]  # noqa: PYI024


def columns(room: int, n_features: int, n_following: int) -> Any:
    """`Columns` with room for so many decisions."""
    sizes = {"D": room, "F": n_features, "G": n_following}
    return Columns(
        **{
            name: np.empty([sizes[str(letter)] for letter in spec.dims or ()], spec.dtype)
            for name, spec in Decisions.arrays().items()
        }
    )


class Course(Record):
    """What happened in an episode, or in a fragment of one, of T steps.

    Attributes:
        level_hash: of the level's content.
        max_steps: the step limit of the level.
        first_step: steps of the episode before.
        over: the episode has ended.
        decisions: those of the T steps.
        rewards: [T, N], what is learned from; any finite numbers.
        arrived_at: [N], the step since the start of the episode on which a train arrived, -1 for none so far.
        final_observations: [N, F], what trains saw that the step limit stopped; else zeros.
        final_allowed: [N], what would be allowed to trains that the step limit stopped, a bit an action; else all.
        states: [N, S], what trains carry along; S is 0 but for recurrent networks.
        score: flatland-rl 4.3.0's own normalised score of a level of its rules, once the episode is over; else None.
    """

    level_hash: Digest
    max_steps: Annotated[int, Field(ge=1, le=MOST_STEPS)]
    first_step: Annotated[int, Field(ge=0, le=MOST_STEPS)]
    over: bool
    decisions: Decisions
    rewards: Annotated[NDArray[np.float32], Array("float32", ("T", "N"))]
    arrived_at: Annotated[NDArray[np.int32], Array("int32", ("N",))]
    final_observations: Annotated[NDArray[np.float32], Array("float32", ("N", "F"))]
    final_allowed: Annotated[NDArray[np.uint8], Array("uint8", ("N",))]
    states: Annotated[NDArray[np.float32], Array("float32", ("N", "S"))]
    score: float | None = None

    def check(self) -> None:
        """Raises ValueError for indices out of range."""
        # In lists: a fragment is short, and numpy's way to the least of a column costs more than the column.
        steps, trains = self.rewards.shape
        first, end = self.first_step, self.first_step + steps
        if len(self.decisions):
            check_range("decisions.times", self.decisions.times, first, end)
            check_range("decisions.trains", self.decisions.trains, 0, trains)
            check_range("decisions.actions", self.decisions.actions, 0, 5)
            check_range("decisions.allowed", self.decisions.allowed, 1, 1 << 5)
            check_range("decisions.labels", self.decisions.labels, NONE, 5)
            chosen = zip(self.decisions.actions.tolist(), self.decisions.allowed.tolist(), strict=True)
            if not all(bits >> action & 1 for action, bits in chosen):
                raise ValueError("decisions.actions: one is not among those allowed")
        features, following = self.decisions.observations.shape[1], self.decisions.following.shape[1]
        if following not in (0, features):
            raise ValueError(f"decisions.following: wants no features or {features}, got {following}")
        if not 1 <= steps <= self.max_steps - self.first_step or trains < 1:
            most = self.max_steps - self.first_step
            raise ValueError(f"rewards: wants 1..{most} steps of at least one train, got {steps} of {trains}")
        check_range("arrived_at", self.arrived_at, NONE, end)
        check_range("final_allowed", self.final_allowed, 1, 1 << 5)
        if self.score is not None and not self.over:
            raise ValueError(f"score: {self.score} of an episode that is not over")

    @property
    def n_trains(self) -> int:
        return len(self.arrived_at)

    @property
    def last_step(self) -> int:
        """Steps of the episode so far."""
        return self.first_step + len(self.rewards)

    @property
    def normalised_return(self) -> float:
        """The study's measure of the episode so far, whatever was learned from; see `normalised_return`."""
        return normalised_return(self.arrived_at, self.last_step, self.max_steps)


def check_range(name: str, column: NDArray[Any], first: int, end: int) -> None:
    """Raises ValueError for a column, not empty, with numbers below `first`, or from `end` on."""
    values = column.tolist()
    if min(values) < first or max(values) >= end:
        raise ValueError(f"{name}: wants values in {first}..{end - 1}")


def normalised_return(arrived_at: NDArray[np.int32], steps: int, max_steps: int) -> float:
    """What the study reports: the sum of its rewards over the number of trains times the step limit.

    A train costs 1 for every step before that of its arrival, or for all steps; everyone gets 1 once all have arrived.

    Args:
        arrived_at: [N], the step of each arrival, counted from 0; -1 for none.
        steps: how many the episode had.
        max_steps: the step limit.

    >>> normalised_return(np.array([2, -1]), steps=5, max_steps=10)  # -(2 + 5) / (2 * 10)
    -0.35
    >>> normalised_return(np.array([2, 3]), steps=4, max_steps=10)  # (-(2 + 3) + 2) / (2 * 10)
    -0.15
    """
    arrived = arrived_at >= 0
    total = len(arrived_at) * bool(arrived.all()) - int(np.where(arrived, arrived_at, steps).sum())
    return total / (len(arrived_at) * max_steps)
