"""Files of recorded episodes: one .npz, the names of an episode's arrays led by its own, as in `easy_02_grid`.

| array | shape | |
|---|---|---|
| grid | [H, W] | flatland's transition maps |
| agents | [N, 5] | row, column and heading at the start, row and column of the target |
| max_steps | [] | the step limit |
| actions | [T, N] | what trains were told |
| positions | [T, N, 3] | row, column and heading after a step, -1 off the map |
| rewards | [T, N] | |
| status | [T, N] | after a step, in the numbers of flatland 2.2.2 |
| required | [T, N] | whether an action was required after a step |
| trees | [P, N, nodes, 12] | what was seen before the first P steps; P is at most T + 1, and may be 0 |
| ended | [] | whether the episode was over after the last step; may be left out |

A tree's nodes are in pre-order: root, left, forward, right, back; missing ones, and trains that have arrived, are NaN.
Files are checked before they are believed; other arrays in them are not looked at.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.files import LevelFileError, problem_with
from railctl.common.levels.level import Level
from railctl.common.rail.world import N_ACTIONS

READY_TO_DEPART, ACTIVE, ARRIVED = 0, 1, 3  # 2 would be a train that has arrived and stays on the map
DEPTHS = {5: 1, 21: 2, 85: 3}  # of trees, by their nodes
INTEGERS, NUMBERS, TRUTHS, FLOATS = "iu", "iuf", "biu", "f"  # numpy's kinds, a letter each
_KINDS = {INTEGERS: "integers", NUMBERS: "numbers", TRUTHS: "truth values", FLOATS: "floating-point numbers"}


class Course(NamedTuple):
    """What came of an episode; shapes as above."""

    position: NDArray[Any]
    reward: NDArray[Any]
    status: NDArray[Any]
    required: NDArray[np.bool_]
    tree: NDArray[Any]
    ended: bool | None


class RecordedEpisode(NamedTuple):
    """A level, what its trains were told [T, N], and what came of it."""

    name: str
    level: Level
    actions: NDArray[np.int8]
    course: Course


class _Form(NamedTuple):
    """What an array looks like; equal letters are equal sizes."""

    shape: tuple[str | int, ...]
    kinds: str
    content: str


_FORMS = {
    "grid": _Form(("H", "W"), INTEGERS, "the transition map of every cell"),
    "agents": _Form(("N", 5), INTEGERS, "start row, column, heading and target row, column of every train"),
    "max_steps": _Form((), INTEGERS, "the step limit, one number"),
    "actions": _Form(("T", "N"), INTEGERS, "the action of every train in every step"),
    "positions": _Form(("T", "N", 3), INTEGERS, "row, column, heading of every train after every step"),
    "rewards": _Form(("T", "N"), NUMBERS, "the reward of every train in every step"),
    "status": _Form(("T", "N"), INTEGERS, "the status of every train after every step"),
    "required": _Form(("T", "N"), TRUTHS, "whether every train had to be told an action after every step"),
    "trees": _Form(("P", "N", "nodes", 12), FLOATS, "the tree of every train before the first steps"),
}
_ENDED = _Form((), TRUTHS, "whether the episode was over after the last step, one value")


def episode_names(path: Path, arrays: Mapping[str, NDArray[Any]]) -> list[str]:
    """The episodes of a file, in its order.

    Raises:
        LevelFileError: there are none.
    """
    ends = [f"_{name}" for name in _FORMS]
    names = dict.fromkeys(key.removesuffix(end) for key in arrays for end in ends if key.endswith(end))
    episodes = [name for name in names if not name.endswith("_levels") or f"{name}_actions" in arrays]
    if not episodes and names:
        raise LevelFileError(f"{path} holds levels, not recordings of episodes: railctl levels show draws them")
    if not episodes:
        known = ", ".join(f"NAME_{name}" for name in _FORMS)
        raise LevelFileError(f"{path} holds no recordings: name the arrays of an episode {known}")
    return episodes


def read_episode(path: Path, arrays: Mapping[str, NDArray[Any]], name: str) -> RecordedEpisode:
    """One episode of a file.

    Raises:
        LevelFileError: it lacks an array, or one holds what it cannot.
    """
    forms = _FORMS | ({"ended": _ENDED} if f"{name}_ended" in arrays else {})
    sizes: dict[str | int, int] = {}
    found = {}
    for part, form in forms.items():
        key = f"{name}_{part}"
        if key not in arrays:
            raise LevelFileError(f"{path} lacks the array {key}: it must hold {form.content}")
        found[part] = arrays[key]
        problem = _problem_with(found[part], form, sizes) or _problem_with_values(part, found)
        if problem is not None:
            raise LevelFileError(f"{path}: {key} {problem}: it must hold {form.content}")
    agents = found["agents"].astype(np.int32)
    level = Level(found["grid"].astype(np.uint16), agents[:, :3], agents[:, 3:], int(found["max_steps"]))
    problem = problem_with(level)
    if problem is not None:
        raise LevelFileError(f"{path}: episode {name}: {problem}: correct {name}_grid, _agents or _max_steps")
    course = Course(
        position=found["positions"],
        reward=found["rewards"],
        status=found["status"],
        required=found["required"].astype(np.bool_),
        tree=found["trees"],
        ended=bool(found["ended"]) if "ended" in found else None,
    )
    return RecordedEpisode(name, level, found["actions"].astype(np.int8), course)


def _problem_with(array: NDArray[Any], form: _Form, sizes: dict[str | int, int]) -> str | None:
    """What is wrong with an array's type or shape, or none; notes the sizes that its shape's letters stand for."""
    if array.dtype.kind not in form.kinds:
        return f"holds {array.dtype}, not {_KINDS[form.kinds]}"
    wanted = [sizes.get(size, size) for size in form.shape]
    fits = [isinstance(size, str) or size == length for size, length in zip(wanted, array.shape, strict=False)]
    if len(wanted) != array.ndim or not all(fits):
        return f"has shape {_shape(array.shape)}, not {_shape(wanted)}"
    sizes.update(zip(form.shape, array.shape, strict=True))
    return None


def _problem_with_values(part: str, found: Mapping[str, NDArray[Any]]) -> str | None:
    """What is wrong with an array that has its form, or none."""
    array = found[part]
    most = {"grid": 0xFFFF, "actions": N_ACTIONS - 1, "max_steps": np.iinfo(np.int32).max}.get(part)
    if most is not None:
        astray = array[(array < 0) | (array > most)]
        return f"holds {astray.flat[0]}, which is not in 0 to {most}" if astray.size else None
    if part == "trees":
        observations, steps = len(array), len(found["actions"])
        if observations > steps + 1:
            return f"has {observations} rows, more than the {steps} steps and the end have"
        if array.shape[2] not in DEPTHS:
            return f"has trees of {array.shape[2]} nodes, not {', '.join(map(str, DEPTHS))}"
    return None


def _shape(sizes: Any) -> str:
    return f"[{', '.join(map(str, sizes))}]"
