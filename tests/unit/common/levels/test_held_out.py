"""Training never sees an evaluation level, and what it sees instead depends on seeds alone."""

from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels import held_out
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.build import build, build_training
from railctl.common.levels.chunks import key_of
from railctl.common.levels.distributions import LegacyLevels, StockLevels, shipped
from railctl.common.levels.generate import generate as generate_any
from railctl.common.levels.held_out import (
    HELD_OUT_LEVELS,
    NAME,
    AllHeldOutError,
    HeldOut,
    is_held_out,
    is_prepared,
    read_hashes,
    retry_seed,
    training_level,
    write_hashes,
)
from railctl.common.levels.level import Level
from railctl.common.levels.prepare import prepare
from railctl.common.levels.shipped import generate
from railctl.common.levels.supply import LevelSupply
from railctl.common.seeding import EVALUATION_BIT, evaluation_level_seed, training_level_seed
from railctl.common.strict import ConfigError

EASY, NOTHING = shipped()["easy"], HeldOut(frozenset())
TINY = LegacyLevels(rules="legacy", size=(10, 10), trains=1, cities=2, held_out=12)
TRAINING = [training_level_seed(1, episode) for episode in range(25)]


def test_the_file_holds_the_first_evaluation_levels():
    for levels in shipped().values():
        drawn = held_out.draw_hashes(levels, generate_any, (0, 1, 2, HELD_OUT_LEVELS - 1))
        assert drawn <= held_out.held_out_hashes()
    stored = np.fromfile(held_out.FILE, "<u8")
    assert (np.diff(stored.astype(object)) > 0).all()
    assert HELD_OUT_LEVELS < len(stored) < 2 * HELD_OUT_LEVELS  # easy and medium lie on the same rails


@pytest.mark.slow
def test_the_file_is_what_the_generator_draws():
    drawn = [held_out.draw_hashes(levels, generate_any, range(HELD_OUT_LEVELS)) for levels in shipped().values()]
    assert set().union(*drawn) == held_out.held_out_hashes()


@pytest.mark.parametrize("name", shipped())
def test_training_levels_are_never_held_out(name: str):
    supply = LevelSupply()
    assert not any(is_held_out(supply.training(name, seed)) for seed in TRAINING)


def test_a_level_that_may_be_used_is_that_of_its_seed():
    plain = {seed: generate("easy", seed) for seed in TRAINING}
    free = [seed for seed, level in plain.items() if not is_held_out(level)]
    assert 10 < len(free) < 25
    for seed in free:
        assert training_level(EASY, seed, generate_any, NOTHING).content_hash == plain[seed].content_hash


def test_one_that_is_held_out_is_replaced_by_the_first_derived_one_that_is_not():
    asked = []
    refused = generate("easy", evaluation_level_seed(0))
    free = next(level for seed in TRAINING if not is_held_out(level := generate("easy", seed)))

    def source(_levels: LegacyLevels, seed: int) -> Level:
        asked.append(seed)
        return refused if len(asked) < 4 else free

    assert training_level(EASY, 7, source, NOTHING) is free
    assert asked == [7, *(retry_seed(7, attempt) for attempt in (1, 2, 3))]
    assert len(set(asked)) == 4
    assert max(asked) < EVALUATION_BIT


def test_a_generator_that_only_repeats_evaluation_levels_is_an_error():
    refused = generate("easy", evaluation_level_seed(0))
    with pytest.raises(AllHeldOutError, match="all evaluation levels: make held_out smaller, or size larger"):
        training_level(EASY, 7, lambda _levels, _seed: refused, NOTHING)


def test_a_bank_changes_nothing_and_spares_the_generator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plain = [LevelSupply().training("easy", seed).content_hash for seed in TRAINING]
    evaluation = [LevelSupply().evaluation("easy", index).content_hash for index in range(3)]
    build(tmp_path, EASY, TRAINING[:10])  # without the levels that stand in
    partly = LevelSupply(root=tmp_path)
    assert [partly.training("easy", seed).content_hash for seed in TRAINING] == plain
    build_training(tmp_path, EASY, TRAINING)
    build(tmp_path, EASY, [evaluation_level_seed(index) for index in range(3)])
    monkeypatch.setattr("railctl.common.levels.supply.generate", None)
    supply = LevelSupply(root=tmp_path)
    assert [supply.training("easy", seed).content_hash for seed in TRAINING] == plain
    assert [supply.evaluation("easy", index).content_hash for index in range(3)] == evaluation


def test_building_training_levels_says_how_many_were_missing(tmp_path: Path):
    built = build_training(tmp_path, EASY, TRAINING[:12])
    assert built == len(LevelBank(tmp_path).seeds("easy")) >= 12
    assert build_training(tmp_path, EASY, TRAINING[:12]) == 0


def test_a_supply_without_a_folder_is_the_generator(tmp_path: Path):
    for root in (None, tmp_path / "nowhere"):
        assert LevelSupply(root=root).level("easy", 3).content_hash == generate("easy", 3).content_hash


def test_a_distribution_of_one_s_own_keeps_its_evaluation_rails_from_training(tmp_path: Path):
    supply = LevelSupply({"tiny": TINY})
    rails = {supply.evaluation("tiny", index).grid_hash for index in range(TINY.held_out)}
    plain = [supply.level("tiny", seed).grid_hash for seed in TRAINING]
    assert rails & set(plain)  # or the test would show nothing
    training = [supply.training("tiny", seed) for seed in TRAINING]
    assert rails.isdisjoint(level.grid_hash for level in training)
    free = [seed for seed, found in zip(TRAINING, plain, strict=True) if found not in rails]
    for seed in free:
        assert training[TRAINING.index(seed)].content_hash == supply.level("tiny", seed).content_hash
    prepare(tmp_path, "tiny", TINY)
    prepared = LevelSupply({"tiny": TINY}, tmp_path)
    assert [level.content_hash for level in training] == [
        prepared.training("tiny", seed).content_hash for seed in TRAINING
    ]


def test_what_is_held_out_is_drawn_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert not is_prepared(tmp_path, TINY)
    assert is_prepared(tmp_path, EASY)
    prepare(tmp_path, "tiny", TINY)
    assert is_prepared(tmp_path, TINY)
    monkeypatch.setattr("railctl.common.levels.prepare.build", None)
    prepare(tmp_path, "tiny", TINY)
    rails = read_hashes(tmp_path, TINY)
    assert HeldOut.of(TINY, LevelBank(tmp_path), lambda _levels, _seed: pytest.fail("it was drawn")).hashes == rails


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: data[:9], lambda data: b"[]\n" + data])
def test_damaged_hashes_are_not_believed(tmp_path: Path, damage):
    write_hashes(tmp_path, TINY, {1, 2, 2**64 - 1})
    assert read_hashes(tmp_path, TINY) == {1, 2, 2**64 - 1}
    path = tmp_path / key_of(TINY) / NAME
    path.write_bytes(damage(path.read_bytes()))
    assert read_hashes(tmp_path, TINY) is None


def test_too_few_rails_are_refused_before_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(held_out, "TRIES", 1)
    monkeypatch.setattr("railctl.common.levels.prepare.SAMPLE", 30)
    levels = StockLevels(rules="stock", size=(10, 6), trains=1, cities=2, held_out=60)
    with pytest.raises(ConfigError, match=r"levels\.tiny: 1 draws for training level \d+ were all evaluation levels"):
        prepare(tmp_path, "tiny", levels)


def test_what_has_no_levels_is_refused_before_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("railctl.common.levels.legacy.ROUTE_TRIES", 0)
    with pytest.raises(ConfigError, match=r"levels\.tiny: no feasible level for seed"):
        prepare(tmp_path, "tiny", TINY)
