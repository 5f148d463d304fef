"""Global and local maps, by hand; parity with the library's global one is tested by whole episodes."""

import numpy as np
import pytest
from made_rails import EAST, WEST, line, scheduled

from railctl.common.levels.distributions import Bounds, shipped
from railctl.common.levels.legacy import generate
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.local_map import LocalObservation
from railctl.common.rail.observations.maps import CHANNELS
from railctl.common.rail.world import MOVE_FORWARD, STOP_MOVING

BOUNDS = Bounds(2, 8, 3)
LEVEL = line((1, EAST, 5), (3, WEST, 0), (1, EAST, 6), max_steps=30)


def global_map(rules: str = "stock", bounds: Bounds = BOUNDS) -> np.ndarray:
    """[H, W, 23]: what the first train sees when it and the second stand on the map, the second broken down."""
    level = scheduled(LEVEL, speeds=[(1, 1), (1, 2), (1, 1)]) if rules == "stock" else LEVEL
    world = CompiledWorld(1, 3, rules=rules, observation=GlobalObservation(), bounds=bounds)
    world.load(0, level)
    for _ in range(2 if rules == "stock" else 1):
        world.obey(np.array([[MOVE_FORWARD, MOVE_FORWARD, STOP_MOVING]], np.int8))
    world.obey(np.array([[STOP_MOVING, MOVE_FORWARD, STOP_MOVING]], np.int8))
    world.batch.trains[0, 1]["malfunction"] = 20
    return world.observe(0, 0).reshape(bounds.height, bounds.width, CHANNELS)


def where(channel: np.ndarray) -> dict[tuple[int, ...], float]:
    """What is not 0."""
    return {tuple(place.tolist()): pytest.approx(float(channel[*place])) for place in np.argwhere(channel)}


def test_every_channel_by_hand():
    seen = global_map()
    rails = {(0, 0): [15 - 2], (0, 6): [15 - 8]}  # dead ends: in heading west, out east; in heading east, out west
    rails |= {(0, column): [15 - 10, 15 - 0] for column in range(1, 6)}
    for row, column in np.ndindex(2, 8):
        assert np.flatnonzero(seen[row, column, :16]).tolist() == rails.get((row, column), [])
    own, other, malfunction, speed, ready, target, targets = np.moveaxis(seen[..., 16:], 2, 0)
    assert where(own) == {(0, 1): 0.5}  # east
    assert where(other) == {(0, 3): 1.0}  # west
    assert where(malfunction) == {(0, 3): 0.4}
    assert where(speed) == {(0, 3): 0.5}  # the first train stands
    assert where(ready) == {(0, 1): 0.2}
    assert where(target) == {(0, 5): 1}
    assert where(targets) == {(0, 0): 1, (0, 5): 1, (0, 6): 1}


def test_under_legacy_rules_speeds_are_constant():
    assert where(global_map("legacy", Bounds(1, 7, 3))[..., 19]) == {(0, 1): 1, (0, 2): 1}


def test_values_have_an_upper_end():
    world = CompiledWorld(1, 7, rules="stock", observation=GlobalObservation(), bounds=Bounds(1, 7, 7))
    level = line(*[(1, EAST, 5)] * 7)
    world.load(0, level)
    world.obey(np.full((1, 7), MOVE_FORWARD, np.int8))
    world.obey(np.full((1, 7), MOVE_FORWARD, np.int8))
    world.batch.trains[0, 0]["malfunction"] = 1000
    seen = world.observe(0, 0).reshape(7, CHANNELS)
    assert seen[1, [18, 20]].tolist() == [1, 1]  # six trains are ready to depart there


@pytest.mark.parametrize("radius", [1, 4, 30])
def test_a_local_map_is_a_window_of_the_global_one(radius: int):
    level, rng = generate(shipped()["hard"], 2), np.random.default_rng(radius)
    kinds = GlobalObservation(), LocalObservation(radius=radius)
    whole, window = (
        CompiledWorld(1, 7, rules="stock", observation=kind, bounds=Bounds(25, 25, 7), decisions="always")
        for kind in kinds
    )
    side = 2 * radius + 1
    assert window.n_features == side * side * CHANNELS
    for world in (whole, window):
        world.load(0, level)
    for _ in range(40):
        where, vectors = window.observe_deciding()
        for (_, train), vector in zip(where.tolist(), vectors, strict=True):
            seen = whole.observe(0, train).reshape(25, 25, CHANNELS)
            [(row, column)] = np.argwhere(seen[..., 16])
            padded = np.pad(seen, ((radius, radius), (radius, radius), (0, 0)))
            expected = padded[row : row + side, column : column + side]
            np.testing.assert_array_equal(vector.reshape(side, side, CHANNELS), expected)
        actions = rng.choice(5, p=[0.05, 0.1, 0.7, 0.1, 0.05], size=(1, 7)).astype(np.int8)
        for world in (whole, window):
            world.step(actions)


def test_a_level_of_any_size_up_to_the_bounds_is_at_the_north_west():
    seen = global_map(bounds=Bounds(9, 9, 3))
    np.testing.assert_array_equal(seen[:2, :8], global_map())
    assert not seen[2:].any()
    assert not seen[:, 8:].any()
