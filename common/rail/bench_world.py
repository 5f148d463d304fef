"""How much faster the compiled world is than flatland-rl 4.3.0: `python -m common.rail.bench_world --json`.

Both play the same levels with the same actions under the library's own rules, in one process, and give the tree of
every train (depth 2) after every step; in the end they must agree. The library plays one level after the other, ours
plays them as a batch. Times are processor times of stepping and looking, a step of one world, medians over repeats;
resets are not counted. The library gets no predictor: in 4.3.0 it changes no tree, and would double the time.
"""

import argparse
import json
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from statistics import median
from typing import Any

import numpy as np
from flatland.core.grid.grid4 import Grid4TransitionsEnum
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.observations import TreeObsForRailEnv
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap
from flatland.envs.rail_trainrun_data_structures import Waypoint
from flatland.envs.timetable_utils import Line, Timetable
from numpy.typing import NDArray

from common.config import DIFFICULTIES
from common.levels.legacy import generate
from common.levels.level import Level
from common.rail.compiled.world import CompiledWorld
from common.rail.from_flatland import level_of, traffic_of

DEPTH = 2
ACTION_MIX = (0.05, 0.1, 0.7, 0.1, 0.05)
SPEEDS = (1.0, 0.5, 0.33, 0.25)
MALFUNCTIONS = MalfunctionParameters(malfunction_rate=1 / 100, min_duration=5, max_duration=15)


@dataclass(frozen=True)
class Row:
    """One comparison; a ratio above 1 says that ours is faster."""

    name: str
    unit: str
    ours: float
    theirs: float
    ratio: float
    repeats: int


class DisagreementError(RuntimeError):
    """The two worlds did not end in the same state: the times mean nothing."""


def environment(level: Level, *, disturbed: bool) -> RailEnv:
    """The library's own environment on a level; `disturbed` by malfunctions and mixed speeds."""
    rail = RailGridTransitionMap(level.grid.shape[1], level.grid.shape[0], grid=level.grid.copy())
    n_trains = level.n_trains
    ways = [Grid4TransitionsEnum(heading) for heading in range(4)]
    waypoints: dict[int, list[list[Waypoint]]] = {}
    for train in range(n_trains):
        row, column, heading = level.starts[train].tolist()
        target = tuple(level.targets[train].tolist())
        ends = [Waypoint(target, way) for way in ways if rail.is_valid_configuration((target, way))]
        waypoints[train] = [[Waypoint((row, column), ways[heading])], ends]
    speeds = [SPEEDS[train % len(SPEEDS)] if disturbed else 1.0 for train in range(n_trains)]
    departures: list[Any] = [[0, None]] * n_trains
    arrivals: list[Any] = [[None, level.max_steps]] * n_trains
    timetable = Timetable(departures, arrivals, level.max_steps)
    return RailEnv(
        level.grid.shape[1],
        level.grid.shape[0],
        rail_generator=lambda *_args: (rail, None),
        line_generator=lambda *_args: Line(waypoints, speeds),
        timetable_generator=lambda *_args: timetable,
        number_of_agents=n_trains,
        obs_builder_object=TreeObsForRailEnv(DEPTH),  # a predictor would change nothing but the time
        malfunction_generator=ParamMalfunctionGen(MALFUNCTIONS) if disturbed else None,
        acceleration_delta=Fraction(1),
        braking_delta=Fraction(-1),
        random_seed=1,
    )


def compare(name: str, levels: Sequence[Level], *, disturbed: bool, steps: int, repeats: int) -> Row:
    """Play `levels` for so many steps, over and over.

    Raises:
        DisagreementError: the worlds differ in the end.
    """
    n_trains = max(level.n_trains for level in levels)
    rng = np.random.default_rng(0)
    actions = rng.choice(5, p=ACTION_MIX, size=(steps, len(levels), n_trains)).astype(np.int8)
    world = CompiledWorld(len(levels), n_trains, rules="stock", tree="stock", depth=DEPTH)
    theirs, ours = [], []
    for repeat in range(repeats + 1):
        environments = [environment(level, disturbed=disturbed) for level in levels]
        for env in environments:
            env.reset(random_seed=repeat)
        for slot, env in enumerate(environments):
            world.load(slot, level_of(env), traffic_of(env))
        our_time, our_steps = _play_ours(world, actions)
        their_time, their_steps = _play_theirs(environments, actions)
        if our_steps != their_steps or not _agree(world, environments):
            raise DisagreementError(f"{name}, repeat {repeat}")
        if repeat > 0:  # the first warms up both
            ours.append(our_time / our_steps * 1e6)
            theirs.append(their_time / their_steps * 1e6)
    ratio = median(theirs) / median(ours)
    return Row(name, "us/step", round(median(ours), 3), round(median(theirs), 1), round(ratio, 1), repeats)


def _play_ours(world: CompiledWorld, actions: NDArray[np.int8]) -> tuple[float, int]:
    """Seconds, and steps of single worlds."""
    running, trees = 0, world.trees()
    begun = time.process_time()
    for chosen in actions:
        running += world.slots - np.count_nonzero(world.over())
        world.obey(chosen)
        world.trees(out=trees)
    return time.process_time() - begun, running


def _play_theirs(environments: Sequence[RailEnv], actions: NDArray[np.int8]) -> tuple[float, int]:
    seconds, played = 0.0, 0
    envs: Sequence[Any] = environments
    for slot, env in enumerate(envs):
        orders = [dict(enumerate(chosen.tolist())) for chosen in actions[:, slot, : len(env.agents)]]
        begun = time.process_time()
        for order in orders:
            if env.dones["__all__"]:
                break
            env.step(order)
            played += 1
        seconds += time.process_time() - begun
    return seconds, played


def _agree(world: CompiledWorld, environments: Sequence[RailEnv]) -> bool:
    """Whether all trains are in the same state, and see the same distance to their targets."""
    trees = world.trees()
    for slot, env in enumerate(environments):
        agents: Any = env.agents
        trains = world.batch.trains[slot, : len(agents)]
        if trains["state"].tolist() != [int(agent.state) for agent in agents]:
            return False
        seen: Any = env.obs_dict
        if trees[slot, : len(agents), 0, 6].tolist() != [
            seen[train].dist_min_to_target for train in range(len(agents))
        ]:
            return False
    return True


def rows(worlds: int, steps: int, repeats: int) -> list[Row]:
    """All comparisons."""
    found = []
    for difficulty in DIFFICULTIES:
        levels = [generate(difficulty, seed) for seed in range(worlds)]
        found.append(compare(f"step+tree {difficulty}", levels, disturbed=False, steps=steps, repeats=repeats))
    name = "step+tree hard, malfunctions and speeds"
    return [*found, compare(name, levels, disturbed=True, steps=steps, repeats=repeats)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the compiled world with flatland-rl.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--worlds", type=int, default=32)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # the library's
    found = rows(arguments.worlds, arguments.steps, arguments.repeats)
    if arguments.json:
        print(json.dumps({"rows": [asdict(row) for row in found]}))  # noqa: T201
        return
    for row in found:
        print(f"{row.name:42} {row.ours:9} {row.theirs:9} {row.unit}  {row.ratio}x")  # noqa: T201


if __name__ == "__main__":
    main()
