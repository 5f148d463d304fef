"""Paths that start from the folder of a run file, made whole."""

from pathlib import Path

from railctl.deploy.whole_paths import files_of, with_whole_paths

GIVEN = {
    "levels": {
        "mine": {"files": ["a/*.npz", "/b.pkl"], "evaluation": "held.npz"},
        "shared": {"files": "c.npz", "evaluation": 0.5},
        "drawn": {"rules": "stock", "size": [30, 30]},
    },
    "start_from": {"checkpoint": "one.safetensors", "digest": None},
    "demonstrations": "shown.npz",
    "episodes": 30,
}


def test_all_paths_of_a_run_file_are_found_from_anywhere():
    assert with_whole_paths(GIVEN, Path("/base")) == {
        "levels": {
            "mine": {"files": ["/base/a/*.npz", "/b.pkl"], "evaluation": "/base/held.npz"},
            "shared": {"files": "/base/c.npz", "evaluation": 0.5},
            "drawn": GIVEN["levels"]["drawn"],
        },
        "start_from": {"checkpoint": "/base/one.safetensors", "digest": None},
        "demonstrations": {"file": "/base/shown.npz"},
        "episodes": 30,
    }


def test_what_names_no_file_stays_as_it_is():
    given = {"start_from": None, "episodes": 30}
    assert with_whole_paths(given, Path("/base")) == given
    assert files_of(given) == []


def test_keys_that_name_files_are_told():
    assert files_of(GIVEN) == ["levels.mine", "levels.shared", "start_from", "demonstrations"]
