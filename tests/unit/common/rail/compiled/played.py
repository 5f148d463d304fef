"""A small episode under each set of rules, as a digest: run with and without compilation, it must come out the same."""

import hashlib
from fractions import Fraction

import numpy as np

from common.levels.level import Level
from common.rail.compiled.malfunctions import Malfunctions
from common.rail.compiled.traffic import Traffic
from common.rail.compiled.world import CompiledWorld

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


def digest() -> str:
    """Of all that two worlds do and show."""
    state = hashlib.sha256()
    broken = np.packbits(np.arange(1_000_000) % 17 == 0)
    words = np.append(np.random.RandomState(3).get_state()[1], np.uint32(620)).astype(np.uint32)
    traffic = Traffic(
        speeds=[Fraction(1), Fraction(1, 2), Fraction(2, 5)],
        departures=[0, 3, 1],
        malfunctions=Malfunctions(broken, 2, 5, 0, words),
    )
    rng = np.random.default_rng(1)
    for rules, tree, depth in (("legacy", "legacy", 2), ("stock", "repaired", 3), ("stock", "stock", 1)):
        world = CompiledWorld(2, 3, rules=rules, tree=tree, depth=depth)
        for slot in range(2):
            world.load(slot, LEVEL, traffic if rules == "stock" else Traffic())
        while not world.over().all():
            where, vectors = world.observe_deciding()
            for array in (where, vectors, world.trees(), world.arrived()):
                state.update(array.tobytes())
            state.update(world.step(rng.choice(5, p=[0.1, 0.1, 0.6, 0.1, 0.1], size=(2, 3)).astype(np.int8)).tobytes())
    return state.hexdigest()


if __name__ == "__main__":
    print(digest())  # noqa: T201
