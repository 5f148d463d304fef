"""Training never sees an evaluation level, and what it sees instead depends on seeds alone."""

from pathlib import Path

import numpy as np
import pytest

from common.config import DIFFICULTIES, Difficulty
from common.levels import held_out
from common.levels.bank import LevelBank
from common.levels.build import build, build_training
from common.levels.held_out import HELD_OUT_LEVELS, is_held_out, retry_seed, training_level
from common.levels.level import Level
from common.levels.shipped import generate
from common.levels.supply import LevelSupply
from common.seeding import EVALUATION_BIT, evaluation_level_seed, training_level_seed

TRAINING = [training_level_seed(1, episode) for episode in range(25)]


def test_the_file_holds_the_first_evaluation_levels():
    assert held_out.draw_hashes(generate, (0, 1, 2, HELD_OUT_LEVELS - 1)) <= held_out.held_out_hashes()
    stored = np.fromfile(held_out.FILE, "<u8")
    assert (np.diff(stored.astype(object)) > 0).all()
    assert HELD_OUT_LEVELS < len(stored) < 2 * HELD_OUT_LEVELS  # easy and medium lie on the same rails


@pytest.mark.slow
def test_the_file_is_what_the_generator_draws():
    assert held_out.draw_hashes(generate, range(HELD_OUT_LEVELS)) == held_out.held_out_hashes()


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_training_levels_are_never_held_out(difficulty: Difficulty):
    supply = LevelSupply()
    assert not any(is_held_out(supply.training(difficulty, seed)) for seed in TRAINING)


def test_a_level_that_may_be_used_is_that_of_its_seed():
    plain = {seed: generate("easy", seed) for seed in TRAINING}
    free = [seed for seed, level in plain.items() if not is_held_out(level)]
    assert 10 < len(free) < 25
    for seed in free:
        assert training_level("easy", seed, generate).content_hash == plain[seed].content_hash


def test_one_that_is_held_out_is_replaced_by_the_first_derived_one_that_is_not():
    asked = []
    refused = generate("easy", evaluation_level_seed(0))
    free = next(level for seed in TRAINING if not is_held_out(level := generate("easy", seed)))

    def source(_difficulty: Difficulty, seed: int) -> Level:
        asked.append(seed)
        return refused if len(asked) < 4 else free

    assert training_level("easy", 7, source) is free
    assert asked == [7, *(retry_seed(7, attempt) for attempt in (1, 2, 3))]
    assert len(set(asked)) == 4
    assert max(asked) < EVALUATION_BIT


def test_a_generator_that_only_repeats_evaluation_levels_is_an_error():
    refused = generate("easy", evaluation_level_seed(0))
    with pytest.raises(RuntimeError, match="all evaluation levels"):
        training_level("easy", 7, lambda _difficulty, _seed: refused)


def test_a_bank_changes_nothing_and_spares_the_generator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plain = [LevelSupply().training("easy", seed).content_hash for seed in TRAINING]
    evaluation = [LevelSupply().evaluation("easy", index).content_hash for index in range(3)]
    build(tmp_path, "easy", TRAINING[:10])  # without the levels that stand in
    partly = LevelSupply.from_folder(tmp_path)
    assert [partly.training("easy", seed).content_hash for seed in TRAINING] == plain
    build_training(tmp_path, "easy", TRAINING)
    build(tmp_path, "easy", [evaluation_level_seed(index) for index in range(3)])
    monkeypatch.setattr("common.levels.legacy.generate", None)
    supply = LevelSupply.from_folder(tmp_path)
    assert [supply.training("easy", seed).content_hash for seed in TRAINING] == plain
    assert [supply.evaluation("easy", index).content_hash for index in range(3)] == evaluation


def test_building_training_levels_says_how_many_were_missing(tmp_path: Path):
    built = build_training(tmp_path, "easy", TRAINING[:12])
    assert built == len(LevelBank(tmp_path).seeds("easy")) >= 12
    assert build_training(tmp_path, "easy", TRAINING[:12]) == 0


def test_a_supply_without_a_folder_is_the_generator(tmp_path: Path):
    for root in (None, tmp_path / "nowhere"):
        assert LevelSupply.from_folder(root).level("easy", 3).content_hash == generate("easy", 3).content_hash
