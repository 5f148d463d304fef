"""Recordings are replayed and compared: every difference is counted and the first is named; what is none is refused."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels.files import LevelFileError
from railctl.tools.recordings.findings import FIELDS, Mismatch
from railctl.tools.recordings.replay import replay_file

SMALL = Path(__file__).parents[3] / "parity" / "data" / "flatland222_episodes_small.npz"
NAME = "easy_02"
with np.load(SMALL) as file:
    GOOD = {key: file[key] for key in file.files if key.startswith(NAME)}
STEPS, TRAINS = GOOD[f"{NAME}_actions"].shape


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "recordings.npz"


def changed(part: str, *place: int, to: object) -> dict:
    """The good recording with one number replaced."""
    array = GOOD[f"{NAME}_{part}"].copy()
    array[place] = to
    return GOOD | {f"{NAME}_{part}": array}


def given(**parts: object) -> dict:
    """The good recording with whole arrays replaced, or left out if None."""
    arrays = GOOD | {f"{NAME}_{part}": array for part, array in parts.items()}
    return {key: array for key, array in arrays.items() if array is not None}


def counts(**found: int) -> dict[str, int]:
    return dict.fromkeys(FIELDS, 0) | found


def test_recordings_replay_without_a_difference():
    told = []
    findings = replay_file(SMALL, lambda done, total: told.append((done, total)))
    assert (findings.episodes, findings.agent_steps, findings.mismatches) == (6, 8508, counts())
    assert findings.tree_nodes > 4000
    assert findings.first_mismatch is None
    assert told == [(done, 6) for done in range(7)]


@pytest.mark.parametrize(
    ("arrays", "mismatch"),
    [
        (changed("positions", 60, 0, 2, to=3), Mismatch(NAME, 60, 0, "position", [9, 20, 3], [9, 20, 2])),
        (changed("rewards", 7, 2, to=0), Mismatch(NAME, 7, 2, "reward", 0.0, -1.0)),
        (changed("status", 135, 0, to=2), Mismatch(NAME, 135, 0, "status", 2, 3)),
        (changed("required", 0, 1, to=False), Mismatch(NAME, 0, 1, "required", recorded=False, ours=True)),
        (changed("trees", 3, 1, 0, 4, to=5), Mismatch(NAME, 3, 1, "tree", 5.0, 0.0, node=0, feature=4)),
        (changed("trees", 39, 2, 20, 0, to=5), Mismatch(NAME, 39, 2, "tree", 5.0, "nan", node=20, feature=0)),
        (given(ended=np.array(False)), Mismatch(NAME, 135, None, "status", "goes on", "ended")),
    ],
)
def test_a_difference_is_counted_and_named(path: Path, arrays: dict, mismatch: Mismatch):
    np.savez(path, **arrays)
    findings = replay_file(path)
    assert findings.mismatches == counts(**{mismatch.field: 1})
    assert findings.first_mismatch == mismatch
    json.dumps(findings.document(), allow_nan=False)


def test_the_first_of_many_differences_is_the_earliest(path: Path):
    trees, status = GOOD[f"{NAME}_trees"] + 1, GOOD[f"{NAME}_status"] + 1
    bad = {key.replace("easy", "bad"): array for key, array in given(trees=trees[5:], status=status).items()}
    np.savez(path, **GOOD, **bad)
    findings = replay_file(path)
    assert findings.episodes == 2
    assert findings.mismatches["status"] == STEPS * TRAINS
    assert findings.mismatches["tree"] > 1
    assert findings.first_mismatch is not None
    assert (findings.first_mismatch.episode, findings.first_mismatch.step) == ("bad_02", 0)
    assert findings.first_mismatch.field == "tree"  # seen before the first step


@pytest.mark.parametrize(
    "arrays",
    [
        given(ended=None),
        given(trees=GOOD[f"{NAME}_trees"][:0]),
        given(trees=GOOD[f"{NAME}_trees"][:7].astype(np.float64), max_steps=np.array(STEPS)),
        given(grid=np.pad(GOOD[f"{NAME}_grid"], ((0, 3), (0, 200))).astype(np.int64)),
        given(rewards=GOOD[f"{NAME}_rewards"].astype(np.int8), required=GOOD[f"{NAME}_required"].astype(np.int64)),
        GOOD | {"notes": np.array("by hand"), "easy_levels_grid": GOOD[f"{NAME}_grid"][None]},
    ],
)
def test_other_sizes_types_and_arrays_are_taken(path: Path, arrays: dict):
    np.savez_compressed(path, **arrays)
    assert replay_file(path).mismatches == counts()


def test_a_recording_may_stop_early_or_go_on_after_the_end(path: Path):
    cut = {part: GOOD[f"{NAME}_{part}"][:50] for part in ("actions", "positions", "rewards", "status", "required")}
    np.savez(path, **given(**cut, ended=np.array(False)))
    assert replay_file(path).mismatches == counts()
    still = {part: GOOD[f"{NAME}_{part}"][[*range(STEPS), -1, -1]] for part in cut}
    still["rewards"][STEPS:], still["required"][STEPS:] = 1, False
    np.savez(path, **given(**still))
    assert replay_file(path).mismatches == counts()


def test_a_step_limit_that_the_recording_did_not_have_is_found(path: Path):
    np.savez(path, **given(max_steps=np.array(100)))
    findings = replay_file(path)
    assert findings.mismatches["position"] > 0
    assert findings.first_mismatch is not None
    assert findings.first_mismatch.step == 100


LOST = GOOD[f"{NAME}_agents"].copy()
LOST[1, :2] = 0


@pytest.mark.parametrize(
    ("arrays", "problem"),
    [
        (GOOD | {"two\nlines_grid": GOOD[f"{NAME}_grid"]}, "has arrays whose names cannot be printed"),
        ({}, "holds no recordings: name the arrays of an episode NAME_grid, NAME_agents"),
        ({"easy_levels_grid": GOOD[f"{NAME}_grid"][None]}, "holds levels, not recordings of episodes"),
        (given(status=None), f"lacks the array {NAME}_status: it must hold the status of every train after every step"),
        (given(grid=None), f"lacks the array {NAME}_grid"),
        (given(actions=GOOD[f"{NAME}_actions"] * 1.0), f"{NAME}_actions holds float64, not integers: it must hold"),
        (given(actions=GOOD[f"{NAME}_actions"][:, :2]), rf"{NAME}_actions has shape \[136, 2\], not \[T, 3\]"),
        (given(rewards=GOOD[f"{NAME}_rewards"][1:]), rf"{NAME}_rewards has shape \[135, 3\], not \[136, 3\]"),
        (
            given(positions=GOOD[f"{NAME}_positions"][..., :2]),
            r"shape \[136, 3, 2\], not \[136, 3, 3\]: it must hold row",
        ),
        (given(trees=GOOD[f"{NAME}_trees"][:, :, :9]), f"{NAME}_trees has trees of 9 nodes, not 5, 21, 85"),
        (given(trees=np.zeros((138, 3, 21, 12))), "138 rows, more than the 136 steps and the end"),
        (given(max_steps=np.array([5, 6])), rf"{NAME}_max_steps has shape \[2\], not \[\]"),
        (given(max_steps=np.array(0)), f"episode {NAME}: a step limit of 0"),
        (given(max_steps=np.array(1 << 40)), f"{NAME}_max_steps holds 1099511627776, which is not in 0 to"),
        (given(agents=LOST), "train 1 starts at row 0, column 0, where no rail leads on"),
        (given(grid=np.full((25, 25), 0xFFFF, np.uint16)), f"episode {NAME}: the level's rails lead off the grid"),
        (changed("actions", 3, 1, to=5), f"{NAME}_actions holds 5, which is not in 0 to 4: it must hold the action"),
        (given(status=GOOD[f"{NAME}_status"].astype(object)), f"array {NAME}_status holds Python objects, which are"),
    ],
)
def test_what_is_no_recording_is_named(path: Path, arrays: dict, problem: str):
    np.savez(path, **arrays)
    with pytest.raises(LevelFileError, match=problem) as refusal:
        replay_file(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"text", pickle.dumps([1])])
def test_what_is_no_archive_is_refused(path: Path, content: bytes):
    path.write_bytes(content)
    with pytest.raises(LevelFileError, match=r"is no readable \.npz file of arrays"):
        replay_file(path)


@pytest.mark.parametrize("before", [0, 20])  # in the array's numbers, and in its header
def test_damage_inside_is_named(path: Path, before: int):
    np.savez(path, **GOOD)
    data = bytearray(path.read_bytes())
    place = data.index(GOOD[f"{NAME}_rewards"].tobytes())
    data[place - before] ^= 1
    path.write_bytes(data)
    with pytest.raises(LevelFileError, match=f"the array {NAME}_rewards is damaged"):
        replay_file(path)


def test_one_array_is_no_archive(path: Path):
    with path.open("wb") as file:
        np.save(file, np.arange(3))
    with pytest.raises(LevelFileError, match="it holds a single array"):
        replay_file(path)
