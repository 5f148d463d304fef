"""Level files of a run: divided by their rails, kept, and found again."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from railctl.common.levels import files
from railctl.common.levels.distributions import Bounds, LevelFiles, shipped
from railctl.common.levels.level import Level
from railctl.common.levels.own import divided, read_level_files, with_files_read
from railctl.common.levels.shipped import generate
from railctl.common.levels.supply import LevelSupply
from railctl.common.strict import ConfigError

LEVELS = [generate("easy", seed) for seed in range(8)]
MIXED = [*LEVELS, generate("hard", 1), generate("hard", 2)]


def on_rails_of(level: Level, other: Level) -> Level:
    """Another level on the same rails."""
    return replace(level, starts=other.starts, targets=other.targets, grid=other.grid, max_steps=level.max_steps + 1)


def keep(levels: dict, base: Path, folder: Path) -> None:
    """As a new run does."""
    read_level_files("mine", levels["mine"], base).save(folder, "mine")


def hashes(levels) -> list[str]:
    return [level.content_hash for level in levels]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    files.save(tmp_path / "a.npz", {"easy": LEVELS[:5], "hard": MIXED[8:]})
    files.save(tmp_path / "b.npz", {"easy": LEVELS[5:]})
    return tmp_path


@given(
    rails=st.lists(st.integers(0, 5), min_size=1, max_size=20),
    share=st.floats(0.01, 0.99),
)
def test_no_rails_are_on_both_sides(rails: list[int], share: float):
    levels = [replace(LEVELS[at], max_steps=100 + number) for number, at in enumerate(rails)]
    training, evaluation = divided(levels, share)
    assert sorted(hashes(training + evaluation)) == sorted(hashes(levels))
    assert {level.grid_hash for level in training}.isdisjoint(level.grid_hash for level in evaluation)
    different = len({level.grid_hash for level in levels})
    assert (bool(training), bool(evaluation)) == (True, different > 1)
    reversed_training, _ = divided(levels[::-1], share)
    assert sorted(hashes(reversed_training)) == sorted(hashes(training))


def test_a_share_by_hand():
    rails = {level.grid_hash for level in MIXED}
    assert len(rails) == len(MIXED)
    training, evaluation = divided(MIXED, 0.3)
    assert (len(training), len(evaluation)) == (7, 3)
    assert {level.grid_hash for level in evaluation} == set(sorted(rails)[:3])


def test_patterns_find_files_and_sizes_are_known(folder: Path):
    found = read_level_files("mine", LevelFiles(files=("*.npz",)), folder)
    assert found.spec.bounds == Bounds(25, 25, 7)
    assert (found.spec.found.training, found.spec.found.evaluation) == (8, 2)
    assert found.spec.evaluation_levels == 2
    absolute = read_level_files("mine", LevelFiles(files=(str(folder / "[ab].npz"),)), Path("/"))
    assert absolute.spec.identity == found.spec.identity
    other = read_level_files("mine", LevelFiles(files=("*.npz",), evaluation=0.5), folder)
    assert other.spec.identity != found.spec.identity


def test_files_of_their_own_are_the_evaluation_and_their_rails_are_left_out(folder: Path):
    same_rails = on_rails_of(LEVELS[0], LEVELS[1])
    files.save(folder / "evaluation.npz", {"easy": [same_rails]})
    spec = LevelFiles(files=("a.npz", "b.npz"), evaluation=("evaluation.npz",))
    found = read_level_files("mine", spec, folder)
    assert hashes(found.evaluation) == [same_rails.content_hash]
    assert LEVELS[1].content_hash not in hashes(found.training)
    assert len(found.training) == 9


@pytest.mark.parametrize(
    ("spec", "problem"),
    [
        ({"files": "no*.npz"}, r"levels\.mine\.files no\*\.npz: no such file"),
        ({"files": "**.npz"}, r"levels\.mine\.files \*\*\.npz: it is no pattern: use one as levels/\*\.pkl, or "),
        ({"files": ""}, r"levels\.mine\.files : it is no pattern: use one as "),
        ({"files": "/"}, r"levels\.mine\.files /: it is no pattern: use one as "),
        ({"files": "a.npz", "evaluation": "."}, r"levels\.mine\.evaluation \.: it is no pattern: use one as "),
        ({"files": "**/" * 999}, r"levels\.mine\.files [*/]*: it is no pattern: use one as "),
        ({"files": "a" * 300}, r"levels\.mine\.files a*: .*a\.\.\.: File name too long: use a pattern that does not "),
        ({"files": "bad.npz"}, r"levels\.mine\.files .*bad\.npz is no readable \.npz"),
        ({"files": "one.npz"}, r"1 levels on the same rails cannot be divided"),
        ({"files": "one.npz", "evaluation": "one.npz"}, "all levels lie on the rails of evaluation levels"),
        ({"files": "one.npz", "evaluation": "no.npz"}, r"levels\.mine\.evaluation no\.npz: no such file"),
    ],
)
def test_what_cannot_be_used_is_one_line(folder: Path, spec: dict, problem: str):
    files.save(folder / "one.npz", {"easy": LEVELS[:1]})
    (folder / "bad.npz").write_text("nothing")
    with pytest.raises(ConfigError, match=problem) as caught:
        read_level_files("mine", LevelFiles.model_validate(spec), folder)
    assert "\n" not in str(caught.value)


def test_a_run_keeps_its_levels(folder: Path, tmp_path: Path):
    levels = with_files_read({"mine": LevelFiles(files=("*.npz",)), "easy": shipped()["easy"]}, folder)
    kept = tmp_path / "run"
    keep(levels, folder, kept)
    for path in folder.glob("*.npz"):
        path.unlink()
    supply = LevelSupply(levels, kept=kept)
    training = [supply.training("mine", seed).content_hash for seed in range(8)]
    assert len(set(training)) == 8
    assert supply.training("mine", 8 * 10**12 + 3).content_hash == training[3]
    evaluation = [supply.evaluation("mine", index, sequence=3) for index in range(2)]
    assert set(hashes(evaluation)).isdisjoint(training)
    with pytest.raises(ConfigError, match=r"levels\.mine has 2 evaluation levels: there is none of index 2"):
        supply.evaluation("mine", 2)


def test_without_a_copy_the_files_themselves_are_read(folder: Path, tmp_path: Path):
    levels = with_files_read({"mine": LevelFiles(files=("*.npz",))}, folder)
    keep(levels, folder, tmp_path / "run")
    kept, direct = LevelSupply(levels, kept=tmp_path / "run"), LevelSupply(levels, base=folder)
    for seed in range(8):
        assert kept.training("mine", seed).content_hash == direct.training("mine", seed).content_hash
    with pytest.raises(ConfigError, match="no folder with the run's copy"):
        LevelSupply(levels).training("mine", 0)


def test_another_copy_than_the_run_began_with_is_refused(folder: Path, tmp_path: Path):
    levels = with_files_read({"mine": LevelFiles(files=("*.npz",))}, folder)
    kept = tmp_path / "run"
    keep(levels, folder, kept)
    files.save(kept / "mine.npz", {"training_0000": LEVELS[:2], "evaluation_0000": LEVELS[2:3]})
    with pytest.raises(ConfigError, match="does not hold the levels that the run began with"):
        LevelSupply(levels, kept=kept).training("mine", 0)
    (kept / "mine.npz").unlink()
    with pytest.raises(ConfigError, match=r"levels\.mine: .*no such file"):
        LevelSupply(levels, kept=kept).training("mine", 0)


def test_what_can_never_be_generated_is_refused_with_them(folder: Path):
    small = shipped()["easy"].model_copy(update={"size": (6, 6)})
    with pytest.raises(ConfigError, match=r"levels\.small\.size"):
        with_files_read({"small": small}, folder)
