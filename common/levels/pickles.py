"""Reading levels out of flatland-rl's own .pkl files (`RailEnvPersister.save`), without flatland and without trust.

A pickle may name any function to be called. Here only what rebuilds numpy's numbers and arrays is; every other name
becomes an inert `Stub` that remembers what it was given. What a level holds is read out of those: rails, starts,
targets and the step limit. Speeds, timetables and malfunctions of the file are left out, and trains on their way are
put back to their starts.
"""

import pickle
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np

from common.levels.files import LevelFileError, problem_with
from common.levels.level import Level

HARMLESS = {
    ("numpy", "dtype"): np.dtype,
    ("numpy", "ndarray"): np.ndarray,
    ("numpy.core.multiarray", "scalar"): np.core.multiarray.scalar,  # type: ignore[attr-defined]
    ("numpy.core.multiarray", "_reconstruct"): np.core.multiarray._reconstruct,  # type: ignore[attr-defined]  # noqa: SLF001
    ("numpy._core.multiarray", "scalar"): np.core.multiarray.scalar,  # type: ignore[attr-defined]
    ("numpy._core.multiarray", "_reconstruct"): np.core.multiarray._reconstruct,  # type: ignore[attr-defined]  # noqa: SLF001
    ("fractions", "Fraction"): Fraction,
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
}
AGENT_POSITION, AGENT_HEADING, AGENT_TARGETS = 0, 1, 3  # fields of flatland's `Agent`, in all versions since 3


class Stub:
    """Stands for an object of a class that is not looked up."""

    arguments: tuple[Any, ...]

    def __new__(cls, *arguments: Any, **_options: Any) -> Self:
        """Pickles make objects without calling `__init__`."""
        stub = super().__new__(cls)
        stub.arguments = arguments
        return stub

    def __setstate__(self, state: Any) -> None:
        """Nobody asks for it."""


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        return HARMLESS.get((module, name), Stub)


def load_pickle(path: Path) -> Level:
    """The level of a file that flatland-rl 3 or 4 saved.

    Raises:
        LevelFileError: it cannot be read, or holds what a level cannot.
    """
    try:
        with path.open("rb") as file:
            content = _Reader(file).load()
    except FileNotFoundError:
        raise LevelFileError(f"{path}: no such file") from None
    except Exception:  # noqa: BLE001  (a broken pickle raises anything)
        raise LevelFileError(f"{path} is no pickle of a flatland environment") from None
    try:
        level = _level(content)
    except LevelFileError as error:
        raise LevelFileError(f"{path}: {error}") from None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError):
        raise LevelFileError(f"{path} is not as flatland-rl 3 or 4 saves an environment") from None
    problem = problem_with(level)
    if problem is not None:
        raise LevelFileError(f"{path}: {problem}")
    return level


def _level(content: dict[str, Any]) -> Level:
    if content.get("level_free_positions"):
        raise LevelFileError("has level-free crossings, which are not supported")
    agents = [agent.arguments if isinstance(agent, Stub) else tuple(agent) for agent in content["agents"]]
    return Level(
        grid=np.array(content["grid"], np.uint16),
        starts=np.array(
            [(*agent[AGENT_POSITION], _number(agent[AGENT_HEADING])) for agent in agents], np.int32
        ).reshape(-1, 3),
        targets=np.array([_target(agent[AGENT_TARGETS]) for agent in agents], np.int32).reshape(-1, 2),
        max_steps=int(content["max_episode_steps"]),
    )


def _number(heading: Any) -> int:
    """A heading as a number, which flatland also writes as an enum."""
    return int(heading.arguments[0] if isinstance(heading, Stub) else heading)


def _target(targets: Any) -> tuple[int, int]:
    """The cell of a target: written as such before 4.3, since then as all cells and headings that count."""
    cells = {position for position in targets if isinstance(position, tuple)}
    if not cells:
        row, column = targets
        return int(row), int(column)
    cells = {(int(row), int(column)) for (row, column), _heading in cells}
    if len(cells) != 1:
        raise LevelFileError("a train has targets in several cells, which is not supported")
    return next(iter(cells))
