"""Episodes recorded with flatland-rl 2.2.2 replay without a difference.

A recording holds, per episode, the grid and trains, what every train was told in every step, and what came of it:
positions (-1 off the map), rewards, status (3 arrived), whether an action was required after the step, and the raw
trees of the first observations.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from common.levels.level import Level
from common.rail.flatland_world import FlatlandEpisode

HERE = Path(__file__).parent
SMALL = HERE / "data" / "flatland222_episodes_small.npz"
FULL = HERE.parents[2] / "shared" / "data" / "flatland222_episodes.npz"  # where the small file was cut from, if there
ARRIVED = 3


@cache
def recording(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return dict(file)


def names(path: Path) -> list[str]:
    return [key.removesuffix("_grid") for key in recording(path) if key.endswith("_grid")]


EPISODES = [
    pytest.param(path, name, id=f"{path.stem}-{name}")
    for path in (SMALL, FULL)
    if path.exists()
    for name in names(path)
]


@pytest.mark.parametrize(("path", "name"), EPISODES)
def test_a_recorded_episode_replays(path: Path, name: str):
    told = {key.removeprefix(f"{name}_"): value for key, value in recording(path).items() if key.startswith(name)}
    agents = told["agents"].astype(np.int32)
    episode = FlatlandEpisode(Level(told["grid"], agents[:, :3], agents[:, 3:], int(told["max_steps"])))
    compare_trees(episode, told["trees"][0])
    for t, actions in enumerate(told["actions"].tolist()):
        assert not episode.over
        rewards = episode.step(actions)
        places = [(-1, -1, -1) if here is None else here for here in episode.configurations()]
        np.testing.assert_array_equal(places, told["positions"][t])
        np.testing.assert_array_equal(rewards, told["rewards"][t])
        np.testing.assert_array_equal(episode.arrived(), told["status"][t] == ARRIVED)
        free = ~np.array(episode.committed()) & ~np.array(episode.arrived())
        np.testing.assert_array_equal(free, told["required"][t])
        if t + 1 < len(told["trees"]):
            compare_trees(episode, told["trees"][t + 1])
    assert episode.over == bool(told["ended"])


def compare_trees(episode: FlatlandEpisode, expected: np.ndarray) -> None:
    for train, arrived in enumerate(episode.arrived()):
        if arrived:
            assert np.isnan(expected[train]).all()
        else:
            np.testing.assert_array_equal(episode.tree(train), expected[train])
