"""Levels of the study: pure and feasible; that they are the library's is tested in `compiled`."""

import os
import random
import subprocess

import numpy as np
import pytest

from railctl.common.interpreter import PYTHON
from railctl.common.levels import legacy
from railctl.common.levels.compiled.twister import State
from railctl.common.levels.distributions import LegacyLevels, shipped
from railctl.common.levels.generate import generate as generate_any
from railctl.common.levels.legacy import max_episode_steps
from railctl.common.levels.level import InfeasibleLevelError
from railctl.common.levels.shipped import generate
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.seeding import evaluation_level_seed, training_level_seed
from railctl.tools.levels.routes import numbers

NAMES = tuple(shipped())
LARGEST_SEED = 2**32 - 1
HASHES = f"""
from railctl.common.levels.shipped import generate
for difficulty in {NAMES}:
    print(generate(difficulty, 5).content_hash, generate(difficulty, {LARGEST_SEED}).content_hash)
"""


@pytest.mark.parametrize("difficulty", NAMES)
def test_a_level_has_the_shape_of_table_5_1(difficulty: str):
    level = generate(difficulty, 3)
    assert level.grid.shape == (25, 25)
    assert level.n_trains == {"easy": 3, "medium": 5, "hard": 7}[difficulty]
    assert level.max_steps in {"easy": {412}, "medium": {420}, "hard": {418, 428}}[difficulty]
    assert (level.grid.dtype, level.starts.dtype, level.targets.dtype) == (np.uint16, np.int32, np.int32)


def test_the_step_limit_truncates():
    assert [max_episode_steps(25, 25, trains, cities) for trains, cities in ((3, 2), (5, 2), (7, 3))] == [412, 420, 418]
    assert max_episode_steps(25, 25, 7, 2) == 428
    assert max_episode_steps(40, 30, 9, 4) == 578


@pytest.mark.parametrize("difficulty", NAMES)
def test_every_train_can_reach_its_target(difficulty: str):
    world = FlatlandWorld(slots=1, max_trains=7)
    for seed in range(8):
        level = generate(difficulty, seed)
        world.load(0, level)
        for train in range(level.n_trains):
            root_distance = world.observe(0, train)[6]
            assert -1 < root_distance < 0


def test_fresh_processes_draw_the_same_levels():
    printed = set()
    for hash_seed in ("1", "2"):
        process = subprocess.run(
            [*PYTHON, "-c", HASHES],
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert process.stderr == ""
        printed.add(process.stdout)
    here = "".join(f"{generate(name, 5).content_hash} {generate(name, LARGEST_SEED).content_hash}\n" for name in NAMES)
    assert printed == {here}


def test_levels_do_not_change_between_releases():
    assert [generate(name, 1).content_hash for name in NAMES] == [
        "d80d8e5597a0ec649e2877d53657cf84",
        "0c4a7a8d76cc7391e1ce7cfee412eadf",
        "3d86cf964c8ac9d05f8b7c79737da7af",
    ]


def test_global_generators_are_neither_read_nor_moved():
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002  (the global generator is what is tested)
    python_state, numpy_state = random.getstate(), np.random.get_state()[1].tolist()  # noqa: NPY002
    first = generate("hard", 9)
    assert random.getstate() == python_state
    assert np.random.get_state()[1].tolist() == numpy_state  # noqa: NPY002
    random.seed(2)
    np.random.seed(2)  # noqa: NPY002
    assert generate("hard", 9).content_hash == first.content_hash


def test_an_infeasible_draw_is_drawn_anew_from_a_derived_seed(monkeypatch: pytest.MonkeyPatch):
    draw, draws = legacy._draw, []

    def fail_once(levels: LegacyLevels, state: State):
        draws.append(state)
        if len(draws) % 2 == 1:
            raise InfeasibleLevelError
        return draw(levels, state)

    plain = generate("easy", 4)
    monkeypatch.setattr(legacy, "_draw", fail_once)
    retried = [generate("easy", 4).content_hash for _ in range(2)]
    assert retried[0] == retried[1] != plain.content_hash


def test_a_seed_without_a_feasible_level_is_an_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(legacy, "ROUTE_TRIES", 0)
    with pytest.raises(InfeasibleLevelError, match="no feasible level for seed 4"):
        generate("easy", 4)


def test_other_sizes_have_their_own_step_limit_and_tracks():
    levels = LegacyLevels(rules="legacy", size=(30, 44), trains=12, cities=4, rails_between_cities=3, rails_in_city=5)
    level = generate_any(levels, 2)
    assert level.grid.shape == (30, 44)
    assert level.n_trains == 12
    assert level.max_steps in {max_episode_steps(30, 44, 12, cities) for cities in (2, 3, 4)}
    assert min(numbers(level).distances) > 0


def test_training_and_evaluation_never_share_a_seed():
    training = {training_level_seed(run, episode) for run in range(10) for episode in range(500)}
    evaluation = {evaluation_level_seed(index) for index in range(1000)}
    assert training.isdisjoint(evaluation)
    assert max(training | evaluation) <= LARGEST_SEED
