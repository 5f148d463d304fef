"""Files of levels: what goes in comes out, and what is no level is refused by name."""

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from common.levels.pickles import load_pickle
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.persistence import RailEnvPersister
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator

from common.levels import files
from common.levels.files import LevelFileError
from common.levels.level import Level
from common.levels.shipped import generate
from tools.levels.export import save_pickle

LEVELS = [generate("easy", seed) for seed in range(3)]


def hashes(levels: list[Level]) -> list[str]:
    return [level.content_hash for level in levels]


def test_groups_come_back_as_they_were(tmp_path: Path):
    groups = {"easy": LEVELS, "hard": [generate("hard", 1)]}
    files.save(tmp_path / "levels.npz", groups)
    back = files.load(tmp_path / "levels.npz")
    assert {name: hashes(levels) for name, levels in back.items()} == {
        name: hashes(levels) for name, levels in groups.items()
    }
    assert [path.name for path in tmp_path.iterdir()] == ["levels.npz"]


def test_equal_levels_make_equal_files(tmp_path: Path):
    for name in ("a.npz", "b.npz"):
        files.save(tmp_path / name, {"easy": LEVELS})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_levels_of_two_shapes_are_no_group(tmp_path: Path):
    with pytest.raises(LevelFileError, match="levels of mixed differ"):
        files.save(tmp_path / "levels.npz", {"mixed": [LEVELS[0], generate("hard", 1)]})


GOOD = {
    "easy_levels_grid": LEVELS[0].grid[None],
    "easy_levels_agents": np.concatenate([LEVELS[0].starts, LEVELS[0].targets], axis=1)[None],
    "easy_levels_max_steps": np.array([412]),
}
OFF_RAILS = GOOD["easy_levels_agents"].copy()
OFF_RAILS[0, 1, :2] = 0
OUTSIDE = GOOD["easy_levels_agents"].copy()
OUTSIDE[0, 2, 3] = 25


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"easy_levels_grid": None}, "no array named <group>_levels_grid"),
        ({"easy_levels_max_steps": None}, "lacks the array easy_levels_max_steps"),
        ({"easy_levels_max_steps": np.array([412.0])}, "must hold integers"),
        ({"easy_levels_max_steps": np.array([412, 1])}, r"do not have shapes \[K, H, W\]"),
        ({"easy_levels_max_steps": np.array([0])}, "level 0 of easy: a step limit of 0"),
        ({"easy_levels_agents": np.zeros((1, 3, 4), int)}, r"do not have shapes \[K, H, W\]"),
        ({"easy_levels_agents": np.zeros((1, 0, 5), int)}, "level 0 of easy: no trains"),
        ({"easy_levels_agents": OFF_RAILS}, "train 1 starts at row 0, column 0, where no rail leads on"),
        ({"easy_levels_agents": OUTSIDE}, "the target of train 2 at row 25, column .* is not on rails"),
    ],
)
def test_what_is_no_level_is_named(tmp_path: Path, changes: dict, problem: str):
    path = tmp_path / "levels.npz"
    np.savez(path, **{name: array for name, array in (GOOD | changes).items() if array is not None})
    with pytest.raises(LevelFileError, match=problem):
        files.load(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"text", pickle.dumps([1])])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes):
    path = tmp_path / "levels.npz"
    path.write_bytes(content)
    with pytest.raises(LevelFileError, match=r"no readable \.npz"):
        files.load(path)
    with pytest.raises(LevelFileError, match="no such file"):
        files.load(tmp_path / "other.npz")


def test_a_level_survives_flatland_s_own_file(tmp_path: Path):
    level = generate("medium", 4)
    save_pickle(tmp_path / "level.pkl", level)
    assert load_pickle(tmp_path / "level.pkl").content_hash == level.content_hash


def test_flatland_plays_what_was_exported(tmp_path: Path):
    level = generate("hard", 4)
    save_pickle(tmp_path / "level.pkl", level)
    env, _ = RailEnvPersister.load_new(str(tmp_path / "level.pkl"))
    np.testing.assert_array_equal(env.rail.grid, level.grid)
    assert env._max_episode_steps == level.max_steps
    for _ in range(3):
        env.step(dict.fromkeys(range(level.n_trains), 2))
    assert any(agent.current_configuration is not None for agent in env.agents)
    for agent, start in zip(env.agents, level.starts.tolist(), strict=True):
        assert (*agent.initial_configuration[0], agent.initial_configuration[1]) == tuple(start)
        assert agent.earliest_departure == 0


def test_a_file_of_flatland_gives_its_level_even_from_the_middle_of_an_episode(tmp_path: Path):
    env = RailEnv(
        30,
        28,
        rail_generator=sparse_rail_generator(max_num_cities=2),
        line_generator=sparse_line_generator({1.0: 0.5, 0.5: 0.5}),
        number_of_agents=4,
        random_seed=1,
    )
    env.reset()
    expected = Level(
        grid=env.rail.grid.copy(),
        starts=np.array([(*a.initial_configuration[0], int(a.initial_configuration[1])) for a in env.agents], np.int32),
        targets=np.array([next(iter(agent.targets))[0] for agent in env.agents], np.int32),
        max_steps=env._max_episode_steps,
    )
    for _ in range(5):
        env.step(dict.fromkeys(range(4), 2))
    RailEnvPersister.save(env, tmp_path / "env.pkl")
    assert load_pickle(tmp_path / "env.pkl").content_hash == expected.content_hash


class Evil:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("wrap", [lambda evil: evil, lambda evil: {"grid": evil, "agents": [evil]}])
def test_a_pickle_cannot_call_anything(tmp_path: Path, wrap):
    path, target = tmp_path / "evil.pkl", tmp_path / "made by a pickle"
    path.write_bytes(pickle.dumps(wrap(Evil(target))))
    with pytest.raises(LevelFileError, match=f"{path} is not as flatland-rl 3 or 4 saves"):
        load_pickle(path)
    assert not target.exists()


def test_broken_pickles_are_refused(tmp_path: Path):
    save_pickle(tmp_path / "level.pkl", LEVELS[0])
    data = (tmp_path / "level.pkl").read_bytes()
    for cut in (0, 1, 100, len(data) // 2, len(data) - 1):
        (tmp_path / "cut.pkl").write_bytes(data[:cut])
        with pytest.raises(LevelFileError, match=r"cut\.pkl is no pickle"):
            load_pickle(tmp_path / "cut.pkl")
    with pytest.raises(LevelFileError, match="no such file"):
        load_pickle(tmp_path / "other.pkl")
