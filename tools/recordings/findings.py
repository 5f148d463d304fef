"""What is found when recorded episodes are compared with their replays."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.tools.recordings.recorded import Course, RecordedEpisode

FIELDS = ("position", "reward", "status", "required", "tree")


@dataclass(frozen=True)
class Mismatch:
    """Where a recording and its replay differ.

    Attributes:
        episode: its name.
        step: the row of the recorded array; a tree's is seen before that step.
        train: whose it is; none for the end of the episode, which is part of the status.
        field: one of FIELDS.
        recorded: what the recording has.
        ours: what the replay has.
        node: of the tree.
        feature: of the node.
    """

    episode: str
    step: int
    train: int | None
    field: str
    recorded: Any
    ours: Any
    node: int | None = None
    feature: int | None = None


@dataclass
class Findings:
    """Recordings beside their replays: how much was compared, in how many places they differ, and where first.

    A place is a train in a step; of trees, it is a node.
    """

    episodes: int = 0
    agent_steps: int = 0
    tree_nodes: int = 0
    mismatches: dict[str, int] = field(default_factory=lambda: dict.fromkeys(FIELDS, 0))
    first_mismatch: Mismatch | None = None

    def add(self, told: RecordedEpisode, ours: Course) -> None:
        """Compare one more episode."""
        self.episodes += 1
        self.agent_steps += told.actions.size
        self.tree_nodes += int((_is_there(told.course.tree) | _is_there(ours.tree)).sum())
        for name in FIELDS:
            differs = _differ(getattr(told.course, name), getattr(ours, name))
            places = differs.any(axis=-1) if name in ("position", "tree") else differs
            self.mismatches[name] += int(places.sum())
        mismatch = _first_mismatch(told, ours)
        if told.course.ended not in (None, ours.ended):
            self.mismatches["status"] += 1
            ends = _end(told.course), _end(ours)
            mismatch = mismatch or Mismatch(told.name, len(told.actions) - 1, None, "status", *ends)
        self.first_mismatch = self.first_mismatch or mismatch

    def document(self) -> dict[str, Any]:
        return asdict(self)


def _first_mismatch(told: RecordedEpisode, ours: Course) -> Mismatch | None:
    """The first in time; a tree comes before the step that follows it."""
    firsts = []
    for name in FIELDS:
        places = np.argwhere(_differ(getattr(told.course, name), getattr(ours, name)))
        if len(places):
            firsts.append((places[0, 0], name != "tree", FIELDS.index(name), places[0].tolist()))
    if not firsts:
        return None
    *_, number, place = min(firsts)
    name = FIELDS[number]
    at = tuple(place[:2]) if name == "position" else tuple(place)
    values = [_plain(getattr(course, name)[at]) for course in (told.course, ours)]
    return Mismatch(told.name, place[0], place[1], name, *values, *(place[2:] if name == "tree" else ()))


def _end(course: Course) -> str:
    return "ended" if course.ended else "goes on"


def _differ(told: NDArray[Any], ours: NDArray[Any]) -> NDArray[np.bool_]:
    """Where two arrays differ; nothing (NaN) equals nothing."""
    different: NDArray[np.bool_] = (told != ours) & ~(np.isnan(told) & np.isnan(ours))
    return different


def _is_there(tree: NDArray[Any]) -> NDArray[np.bool_]:
    there: NDArray[np.bool_] = ~np.isnan(tree).all(axis=-1)
    return there


def _plain(value: Any) -> Any:
    """As JSON can say it, which knows no NaN and no infinity."""
    plain = value.tolist()
    return str(plain) if isinstance(plain, float) and not np.isfinite(plain) else plain
