"""How much faster the compiled world is than flatland-rl 4.3.0: `railctl bench world`.

Both play the same levels with the same actions under the library's own rules, in one process, and give the tree of
every train (depth 2) after every step; in the end they must agree. The library plays one level after the other, ours
plays them as a batch. Times are processor times of stepping and looking, a step of one world; resets are not counted.
The library gets no predictor: in 4.3.0 it changes no tree, and would double the time.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.observations import TreeObsForRailEnv
from flatland.envs.rail_env import RailEnv
from numpy.typing import NDArray

from railctl.common.levels.distributions import shipped
from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.from_flatland import level_of
from railctl.common.rail.plain_env import plain_environment
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, run, timed
from railctl.tools.levels.library import forget_rails

DEPTH = 2
ACTION_MIX = (0.05, 0.1, 0.7, 0.1, 0.05)
SPEEDS = (1.0, 0.5, 0.33, 0.25)
MALFUNCTIONS = MalfunctionParameters(malfunction_rate=1 / 100, min_duration=5, max_duration=15)


def environment(level: Level, *, disturbed: bool) -> RailEnv:
    """The library's own environment on a level; `disturbed` by malfunctions and mixed speeds."""
    return plain_environment(
        level,
        TreeObsForRailEnv(DEPTH),  # a predictor would change nothing but the time
        [SPEEDS[train % len(SPEEDS)] if disturbed else 1.0 for train in range(level.n_trains)],
        malfunction_generator=ParamMalfunctionGen(MALFUNCTIONS) if disturbed else None,
        acceleration_delta=Fraction(1),  # the default, a float, is converted in every step
        braking_delta=Fraction(-1),
        random_seed=1,
    )


def comparison(name: str, levels: Sequence[Level], *, disturbed: bool, steps: int) -> Comparison:
    """Play `levels` for so many steps."""
    n_trains = max(level.n_trains for level in levels)
    rng = np.random.default_rng(0)
    actions = rng.choice(5, p=ACTION_MIX, size=(steps, len(levels), n_trains)).astype(np.int8)
    world = CompiledWorld(len(levels), n_trains, rules="stock", decisions="always")

    def once(repeat: int) -> list[Sample]:
        environments = [environment(level, disturbed=disturbed) for level in levels]
        for slot, env in enumerate(environments):
            env.reset(random_seed=repeat)
            env.np_random = np.random.RandomState(repeat)
            world.load(slot, level_of(env), malfunction_seed=repeat)
        ours, our_steps = timed(partial(_play_ours, world, actions))
        theirs, their_steps = timed(partial(_play_theirs, environments, actions))
        if our_steps != their_steps or not _agree(world, environments):
            raise DisagreementError(f"{name}, repeat {repeat}")
        forget_rails()
        return [Sample(name, "us/step", ours / our_steps * 1e6, theirs / their_steps * 1e6)]

    return Comparison(name, once)


def _play_ours(world: CompiledWorld, actions: NDArray[np.int8]) -> int:
    """Returns the steps of single worlds."""
    running, trees = 0, None
    for chosen in actions:
        running += world.slots - np.count_nonzero(world.over())
        world.obey(chosen)
        trees = world.trees(out=trees, depth=DEPTH)
    return running


def _play_theirs(environments: Sequence[RailEnv], actions: NDArray[np.int8]) -> int:
    """Returns the steps of all."""
    played = 0
    envs: Sequence[Any] = environments
    for slot, env in enumerate(envs):
        for chosen in actions[:, slot, : len(env.agents)].tolist():
            if env.dones["__all__"]:
                break
            env.step(dict(enumerate(chosen)))
            played += 1
    return played


def _agree(world: CompiledWorld, environments: Sequence[RailEnv]) -> bool:
    """Whether all trains are in the same state, and see the same distance to their targets."""
    trees = world.trees(depth=DEPTH)
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


def comparisons(worlds: int, steps: int) -> list[Comparison]:
    """All that is measured: so many worlds, for so many steps."""
    levels = {name: [generate(name, seed) for seed in range(worlds)] for name in shipped()}
    plain = [comparison(f"step+tree {name}", levels[name], disturbed=False, steps=steps) for name in shipped()]
    name = "step+tree hard, malfunctions, speeds"
    return [*plain, comparison(name, levels["hard"], disturbed=True, steps=steps)]


if __name__ == "__main__":
    run("Compare the compiled world with flatland-rl.", comparisons, worlds=32, steps=60)
