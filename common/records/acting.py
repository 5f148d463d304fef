"""How work is handed out and comes back: questions for work, leases, and fragments of episodes."""

import hashlib
from collections.abc import Iterable
from types import NoneType
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Array, Count, Name, Record
from railctl.common.records.course import Course, check_range

PLAIN = {bool, int, float, str, NoneType}  # what is surely no record: to ask pydantic takes longer
Seconds = Annotated[float, Field(ge=0, le=1e9)]  # thirty years: whatever sleeps meanwhile, and sums stay finite
MOST_KEPT = 10_000  # fragments that a question names: from one snapshot to the next there are far fewer
UNSAID_IF_EMPTY = "following"  # came last, and most runs do without: their digests are as they were before


class Progressed(Record):
    """Where an episode stands after its first fragments, so that any actor can go on with it.

    Here are the `actions` of all decisions so far, in the order of (time, train), and the trains' `states`.
    """

    fragment: Annotated[int, Field(ge=1)]  # the number of the one to come
    first_step: Annotated[int, Field(ge=1)]
    actions: Annotated[NDArray[np.int8], Array("int8", ("E",))]
    states: Annotated[NDArray[np.float32], Array("float32", ("N", "S"))]

    def check(self) -> None:
        """Raises ValueError for actions that there are not."""
        if len(self.actions):
            check_range("actions", self.actions, 0, 5)


class Lease(Record):
    """The right and duty to act an episode, or a fragment of one: all that its outcome depends on but the weights."""

    episode: Count
    level: LevelName
    level_seed: Count
    weights_version: Count
    epsilon: float = Field(ge=0, le=1)
    steps: Annotated[int, Field(ge=1)] | None  # at most; None: to the end of the episode
    progressed: Progressed | None  # None: from the start

    @property
    def fragment(self) -> int:
        """The number of the fragment."""
        return 0 if self.progressed is None else self.progressed.fragment

    @property
    def first_step(self) -> int:
        """Steps of the episode before."""
        return 0 if self.progressed is None else self.progressed.first_step

    @property
    def unit(self) -> tuple[int, int]:
        """Episode and fragment: what names a lease in its run."""
        return self.episode, self.fragment


class Circumstances(Record):
    """What the content of a fragment does not depend on."""

    actor: Name
    acting_s: Seconds
    waited_s: Seconds  # for the lease


class Fragment(Record):
    """An episode or a part of one, as an actor publishes it: what it was asked for, and what happened."""

    lease: Lease
    course: Course
    circumstances: Circumstances

    def check(self) -> None:
        """Raises ValueError for a course that does not answer its lease."""
        lease, course, steps = self.lease, self.course, len(self.course.rewards)
        if course.first_step != lease.first_step:
            raise ValueError(f"course: begins after step {course.first_step}, its lease after {lease.first_step}")
        if lease.steps is None and not course.over:
            raise ValueError("course: is not over, its lease covers all of it")
        if lease.steps is not None and (steps > lease.steps or (steps < lease.steps and not course.over)):
            raise ValueError(f"course: has {steps} steps, its lease {lease.steps}")

    @property
    def whole(self) -> bool:
        """This is all of its episode."""
        return self.course.over and self.course.first_step == 0

    @property
    def digest(self) -> str:
        """Hash of everything but the circumstances: who acted and how long it took."""
        content = _content("lease", self.lease) + _content("course", self.course)
        return hashlib.blake2b(b"".join(content), digest_size=16).hexdigest()


def digest_of(record: Record) -> str:
    """Hash of a record: of every field, by its name."""
    return hashlib.blake2b(b"".join(_content("", record)), digest_size=16).hexdigest()


def _content(name: str, record: Record) -> list[bytes]:
    """Every field of a record, and of those that it is made of: its name and its value."""
    content = []
    values = record.__dict__
    for field in record.names():
        path, value = f"{name}.{field}", values[field]
        if field == UNSAID_IF_EMPTY and not value.size:
            continue
        if type(value) is np.ndarray:
            content += [f"{path}:{value.dtype.str}{value.shape}".encode(), value.tobytes()]
        elif type(value) not in PLAIN and isinstance(value, Record):
            content += _content(path, value)
        else:
            content.append(f"{path}:{value!r}".encode())
    return content


class LeaseRequest(Record):
    """An actor asks for work, and says what it still keeps: rows of (episode, fragment)."""

    actor: Name
    incarnation: Name
    serves: LevelName  # or any
    kept: Annotated[NDArray[np.int64], Array("int64", ("K", 2))]

    @classmethod
    def naming(cls, actor: str, incarnation: str, serves: str, kept: Iterable[tuple[int, int]]) -> Self:
        """The question of who keeps these; if they are too many it names the first, which are wanted first."""
        named = np.array(sorted(kept)[:MOST_KEPT], np.int64).reshape(-1, 2)
        return cls(actor=actor, incarnation=incarnation, serves=serves, kept=named)

    def check(self) -> None:
        """Raises ValueError for more than an actor names."""
        if len(self.kept) > MOST_KEPT:
            raise ValueError(f"kept: names {len(self.kept)} fragments, {MOST_KEPT} are the most")


class LeaseAnswer(Record):
    """The learner's answer: perhaps a lease, and what the actor may forget or must publish again."""

    lease: Lease | None
    safe_before: Count  # episodes below are in a durable snapshot: forget them
    missing: Annotated[NDArray[np.int64], Array("int64", ("K", 2))]  # kept, but not at the learner: publish them again
    finished: bool  # every episode is trained


class Weights(Record):
    """The network's parameters after `version` trained fragments."""

    version: Count
    tensors: dict[Annotated[str, Field(max_length=128)], Annotated[NDArray[np.float32], Array("float32")]]


class WeightsRequest(Record):
    """Asks the learner for one version of the weights."""

    version: Count
