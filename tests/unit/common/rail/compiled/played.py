"""A small episode under each set of rules, as a digest: run with and without compilation, it must come out the same."""

import hashlib

import made_rails
import numpy as np

from railctl.common.levels.distributions import Bounds
from railctl.common.levels.level import Level, Malfunctions
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.local_map import LocalObservation
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.rewards.delay import DelayReward
from railctl.common.rail.rewards.shaped import ShapedReward
from railctl.common.rail.rewards.study import StudyReward

ALONG, ACROSS, CROSSING = 0x0401, 0x8020, 0x8421
SWITCH, CURVE = 0x0C11, 0x4008
WEST_END, EAST_END, NORTH_END = 0x0004, 0x0100, 0x2000
LEVEL = Level(  # a line with a branch to the north, a crossing, and a dead end everywhere
    grid=np.array(
        [
            [0, 0, NORTH_END, 0, NORTH_END, 0],
            [WEST_END, ALONG, SWITCH, ALONG, CROSSING, EAST_END],
            [0, 0, 0, 0, 0x0080, 0],
        ],
        np.uint16,
    ),
    starts=np.array([[1, 1, 1], [1, 3, 3], [0, 4, 0]], np.int32),
    targets=np.array([[1, 5], [0, 2], [2, 4]], np.int32),
    max_steps=40,
)
DISTURBED = made_rails.scheduled(
    LEVEL,
    speeds=[(1, 1), (1, 2), (2, 5)],
    departures=[0, 3, 1],
    arrivals=[9, 30, 20],
    malfunctions=Malfunctions(1 / 17, 2, 5),
)
SHAPED = ShapedReward(arrival=2, progress=0.3, deadlock=-5, delay=0.1)
KINDS = (
    ("legacy", TreeObservation(), StudyReward()),
    ("stock", TreeObservation(depth=3, features="plain", conflicts="repaired"), SHAPED),
    ("stock", TreeObservation(depth=1), DelayReward()),
    ("legacy", GlobalObservation(), SHAPED),
    ("stock", LocalObservation(radius=2), DelayReward()),
    ("stock", TrafficObservation(others=1), DelayReward()),
)


def digest() -> str:
    """Of all that two worlds do and show."""
    state = hashlib.sha256()
    rng = np.random.default_rng(1)
    for rules, observation, reward in KINDS:
        world = CompiledWorld(2, 3, rules=rules, observation=observation, reward=reward, bounds=Bounds(3, 6, 3))
        for slot in range(2):
            world.load(slot, DISTURBED if rules == "stock" else LEVEL, malfunction_seed=slot)
        while not world.over().all():
            where, vectors = world.observe_deciding()
            for array in (where, vectors, world.trees(), world.arrived()):
                state.update(array.tobytes())
            state.update(world.step(rng.choice(5, p=[0.1, 0.1, 0.6, 0.1, 0.1], size=(2, 3)).astype(np.int8)).tobytes())
        state.update(np.array([world.score(slot) for slot in range(2)]).tobytes())
    return state.hexdigest()


if __name__ == "__main__":
    print(digest())  # noqa: T201
