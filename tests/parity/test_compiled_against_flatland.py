"""The compiled world and flatland-rl 4.3.0 side by side: every field of every train, every node of every tree."""

import time
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
import pytest
from flatland.envs.rail_env import RailEnv
from flatland_oracle import ACTION_MIXES, TreeOracle, forget, generators_of, random_env, trains_of

from railctl.common.rail.compiled.arrays import BROKEN, DONE, MOVING, NOWHERE, STOPPED
from railctl.common.rail.compiled.decisions import ALWAYS, decides
from railctl.common.rail.compiled.looking import look_at_all
from railctl.common.rail.compiled.tree import LEGACY, N_NODE_FEATURES, REPAIRED, STOCK, nodes_of, sight_of
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.from_flatland import level_of
from railctl.common.rail.rewards.delay import DelayReward
from railctl.common.rail.world import MOVE_FORWARD

MOST_STEPS = 160
SLOTS = 2
AGENT_STEPS = 200_000


@dataclass
class Comparison:
    """What was compared so far."""

    agent_steps: int = 0
    on_map: int = 0
    broken: int = 0
    arrivals: int = 0
    trees: int = 0
    nodes: int = 0
    finite_conflicts: int = 0
    kinds: set[tuple[bool, bool]] = field(default_factory=set)  # with malfunctions, with several speeds


def trains_in(world: CompiledWorld, slot: int) -> list[tuple]:
    """What `trains_of` says, of a slot of ours."""
    batch, unit = world.batch, int(world.batch.worlds[slot]["unit"])
    rows = []
    for at in range(batch.worlds[slot]["trains"]):
        train = batch.trains[slot, at]
        cell = batch.cells[slot, train["config"] >> 2]
        here = (int(cell["row"]), int(cell["column"]), int(train["config"]) & 3)
        rows.append(
            (
                int(train["state"]),
                None if train["config"] == NOWHERE else here,
                Fraction(int(train["speed"]), unit),
                Fraction(int(train["distance"]), unit),
                int(train["malfunction"]),
                bool(train["done"]),
                bool(decides(train, batch.codes[slot], unit, ALWAYS)),
                int(train["arrived_at"]) if train["arrived_at"] >= 0 else None,
            )
        )
    return rows


def trees_in(world: CompiledWorld, mode: int, depth: int, predicted_steps: int) -> np.ndarray:
    trees = np.full((world.slots, world.max_trains, nodes_of(depth), N_NODE_FEATURES), np.nan, np.float32)
    look_at_all(world.batch, sight_of(world.batch, predicted_steps), mode, depth, trees)
    return trees


def compare_trees(ours: np.ndarray, theirs: np.ndarray, done: Comparison) -> None:
    np.testing.assert_array_equal(ours[: len(theirs)], theirs)
    done.trees += len(theirs)
    done.nodes += int((~np.isnan(theirs[..., 0])).sum())
    done.finite_conflicts += int(np.isfinite(theirs[:, 1:, 3]).sum())


def towards_targets(world: CompiledWorld, actions: np.ndarray) -> None:
    """Replace actions by those that follow the shortest paths."""
    batch = world.batch
    for slot, at in np.argwhere(batch.trains["state"] != DONE).tolist():
        train, distances = batch.trains[slot, at], batch.distances[slot, at]
        here = int(train["start"] if train["config"] == NOWHERE else train["config"])
        ways = [turn for turn in (-1, 0, 1) if batch.codes[slot, here] >> (here + turn) % 4 & 1]
        leads = batch.leads[slot, here & ~3 : (here & ~3) + 4]
        best = min(ways, key=lambda turn: distances[leads[(here + turn) % 4]], default=0)
        actions[slot, at] = MOVE_FORWARD + best


def compare_episodes(rng: np.random.RandomState, world: CompiledWorld, envs: list[RailEnv], done: Comparison) -> None:
    """Run an episode in each environment and its slot, with the same random actions."""
    depth, predicted_steps = int(rng.randint(1, 4)), int(rng.choice([12, 20, 30]))
    mix, guided = ACTION_MIXES[rng.randint(len(ACTION_MIXES))], rng.rand() < 0.5
    oracles = []
    for slot, env in enumerate(envs):
        level = level_of(env)
        world.load(slot, level, generators=generators_of(env))
        oracles.append(TreeOracle(env, depth, predicted_steps))
        done.kinds.add((level.schedule.malfunctions is not None, len(np.unique(level.schedule.speeds, axis=0)) > 1))
    actions = np.zeros((world.slots, world.max_trains), np.int8)
    for step in range(MOST_STEPS + 1):
        stock = trees_in(world, STOCK, depth, predicted_steps)
        repaired = trees_in(world, REPAIRED, depth, predicted_steps)
        legacy = trees_in(world, LEGACY, depth, predicted_steps)
        for slot, (env, oracle) in enumerate(zip(envs, oracles, strict=True)):
            theirs = trains_of(env)
            assert trains_in(world, slot) == theirs
            done.on_map += sum(state in (MOVING, STOPPED, BROKEN) for state, *_ in theirs)
            done.broken += sum(state == BROKEN for state, *_ in theirs)
            compare_trees(stock[slot], oracle.stock(predicting=step % 16 == 0), done)
            if step % 8 == slot:
                compare_trees(repaired[slot], oracle.repaired(), done)
                compare_trees(legacy[slot], oracle.legacy(), done)
        running = [env for env in envs if not env.dones["__all__"]]
        if not running or step == MOST_STEPS:
            break
        actions[:] = rng.choice(5, p=mix, size=actions.shape)
        if guided and rng.rand() < 0.9:
            towards_targets(world, actions)
        rewards = world.obey(actions)
        for slot, env in enumerate(envs):
            if env in running:
                count = len(env.agents)
                env.step(dict(enumerate(actions[slot, :count].tolist())))
                assert rewards[slot, :count].tolist() == [env.rewards_dict[train] for train in range(count)]
                done.agent_steps += count
            assert world.over()[slot] == env.dones["__all__"]
    done.arrivals += int(world.arrived().sum())


def compare_until(seed: int, *, agent_steps: int, most_trains: int, seconds: float) -> Comparison:
    rng, done, begun = np.random.RandomState(seed), Comparison(), time.monotonic()
    world = CompiledWorld(SLOTS, most_trains, rules="stock", reward=DelayReward())
    while done.agent_steps < agent_steps and time.monotonic() - begun < seconds:
        envs = [random_env(rng, most_trains) for _ in range(SLOTS)]
        for episode in range(2):
            if episode:  # the table of malfunctions lives on, its index too
                for env in envs:
                    env.reset(random_seed=int(rng.randint(1 << 30)) if rng.rand() < 0.5 else None)
            compare_episodes(rng, world, envs, done)
        forget()
    return done


def test_a_sample_of_environments_agrees():
    done = compare_until(4, agent_steps=2_000, most_trains=12, seconds=30)
    assert done.agent_steps > 1000
    assert len(done.kinds) > 2
    assert min(done.on_map, done.broken, done.arrivals, done.finite_conflicts) > 0


@pytest.mark.slow
@pytest.mark.parity
@pytest.mark.parametrize("seed", range(4))
def test_many_environments_agree(seed: int):
    done = compare_until(seed, agent_steps=AGENT_STEPS // 4, most_trains=50, seconds=3600)
    assert done.agent_steps >= AGENT_STEPS // 4
    assert len(done.kinds) == 4
    assert min(done.on_map, done.broken, done.arrivals, done.finite_conflicts) > 20
