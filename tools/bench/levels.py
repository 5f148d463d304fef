"""How much faster levels are there than flatland-rl 4.3.0 makes them: `railctl bench levels`.

"generate" makes levels of table 5.1 of the study, of the same seeds: ours with `legacy.generate`, theirs by the `reset`
of a `RailEnv` with `sparse_rail_generator` and `sparse_line_generator`, without timetable or observations. They are not
the same levels: ours are those of 2.2.2, which 4.3.0 cannot draw; theirs are the nearest that it draws (cities have
pairs of tracks). So what is checked is that the library finds no fault with ours: all cells fit to their neighbours,
and every train has a way.

"ready" is a level up to its first step, with the distances to all targets: ours read out of a level bank, checked
against its hash and loaded into a world; theirs by a `reset`. "given" hands the library the level as a grid, so that it
only sets it up, and the distances must be the same. "drawn" is what a `reset` does by default: to generate it.

Making environments, worlds and the bank is not counted, nor does anybody observe anything.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap

from railctl.common.levels.bank import LevelBank
from railctl.common.levels.chunks import chunk_name, write_chunk
from railctl.common.levels.distributions import StockLevels, shipped
from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.plain_env import plain_environment
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, run, timed
from railctl.tools.levels.library import forget_rails, library_environment

PASSES = 10  # over all levels of the bank, or it would be over before it can be timed
ROOT, DISTANCE = 0, 6  # node and feature of a tree: the distance to the target


def comparison(difficulty: str, worlds: int) -> Comparison:
    """Make so many levels, and get them ready; every repeat has seeds of its own."""
    levels_like = shipped()[difficulty]
    nearest = StockLevels(
        rules="stock", size=levels_like.size, trains=levels_like.trains, cities=levels_like.cities, timetable=False
    )

    def once(repeat: int) -> list[Sample]:
        seeds = range(repeat * worlds, (repeat + 1) * worlds)
        generating, levels = timed(lambda: [generate(difficulty, seed) for seed in seeds])
        drawing, drawn_ready, _ = _reset([library_environment(nearest, seed) for seed in seeds])
        _, given_ready, distances = _reset([_given(level) for level in levels])
        for seed, level in zip(seeds, levels, strict=True):
            check_rails(level, f"{difficulty} {seed}")
        forget_rails()
        loading = _load(difficulty, dict(zip(seeds, levels, strict=True)), distances)
        us = 1e6 / worlds
        return [
            Sample(f"generate {difficulty}", "ms/level", generating * us / 1e3, drawing * us / 1e3),
            Sample(f"ready {difficulty}, given", "us/level", loading * us, given_ready * us),
            Sample(f"ready {difficulty}, drawn", "us/level", loading * us, drawn_ready * us),
        ]

    return Comparison(f"levels {difficulty}", once)


def check_rails(level: Level, name: str) -> None:
    """Have the library judge whether a level is one.

    Raises:
        DisagreementError: a cell does not fit to its neighbours, or a train has no way.
    """
    height, width = level.grid.shape
    rail: Any = RailGridTransitionMap(width, height, grid=level.grid.copy())
    if not all(rail.cell_neighbours_valid(cell, True) for cell in np.ndindex(height, width)):
        raise DisagreementError(f"the rails of {name} are broken")
    for (row, column, heading), target in zip(level.starts.tolist(), level.targets.tolist(), strict=True):
        if not rail.check_path_exists((row, column), heading, tuple(target)):
            raise DisagreementError(f"a train of {name} has no way")


def _given(level: Level) -> RailEnv:
    return plain_environment(level, DummyObservationBuilder(), random_seed=0)  # type: ignore[no-untyped-call]


def _reset(environments: Sequence[RailEnv]) -> tuple[float, float, list[list[float]]]:
    """Seconds of all resets; these and the distances; how far the trains are from their targets."""
    envs: Sequence[Any] = environments
    resetting, _ = timed(lambda: [env.reset() for env in envs])
    measuring, maps = timed(lambda: [env.distance_map.get() for env in envs])
    found = []
    for env, distances in zip(envs, maps, strict=True):
        starts = [(*train.initial_configuration[0], train.initial_configuration[1]) for train in env.agents]
        found.append([distances[train, *start] for train, start in enumerate(starts)])
    return resetting, resetting + measuring, found


def _load(difficulty: str, levels: dict[int, Level], distances: Sequence[list[float]]) -> float:
    """Seconds to have all levels ready out of a bank.

    Raises:
        DisagreementError: a train is not as far from its target as the library says.
    """
    world = CompiledWorld(1, max(level.n_trains for level in levels.values()))
    with tempfile.TemporaryDirectory() as folder:
        bank = _bank(Path(folder), difficulty, levels)

        def ready(seed: int) -> None:
            level = bank.get(difficulty, seed)
            assert level is not None  # noqa: S101  (it was just written)
            world.load(0, level)

        for seed, expected in zip(levels, distances, strict=True):
            ready(seed)
            if world.trees()[0, : len(expected), ROOT, DISTANCE].tolist() != expected:
                raise DisagreementError(f"the distances in {difficulty} {seed}")

        def all_ready() -> None:
            for seed in [*levels] * PASSES:
                ready(seed)

        return timed(all_ready)[0] / PASSES


def _bank(root: Path, difficulty: str, levels: dict[int, Level]) -> LevelBank:
    path = root / difficulty / chunk_name(shipped()[difficulty], [*levels])
    path.parent.mkdir()
    write_chunk(path, shipped()[difficulty], [*levels], [*levels.values()])
    return LevelBank(root)


def comparisons(worlds: int) -> list[Comparison]:
    """All that is measured: so many levels of each difficulty."""
    return [comparison(name, worlds) for name in shipped()]


if __name__ == "__main__":
    run("Compare making levels with flatland-rl.", comparisons, worlds=16)
