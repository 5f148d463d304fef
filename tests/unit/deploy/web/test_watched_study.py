"""A study that is watched, from its folder."""

import json

import pytest

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.deploy.study.described import save_study
from railctl.deploy.web.watched_study import WatchedStudy, return_of

STUDY = Study.model_validate(
    {
        "name": "made",
        "contenders": ["dqn", "ppo"],
        "levels": ["easy"],
        "seeds": [1, 2],
        "episodes": 40,
        "evaluation": {"episodes": 100},
        "references": ["planner"],
        "judgement": {"block": 10},
    }
)


@pytest.fixture
def folder(root):
    folder = StudyFolder(root / "made")
    save_study(folder, STUDY)
    return folder


def looked(folder):
    watched = WatchedStudy("made", folder)
    watched.pause = lambda _seconds: True
    watched.look()
    return json.loads(watched.parts["study"].body)


def scored(path, mean):
    path.write_text(json.dumps({"rows": [{"level": "easy", "levels": 100, "mean": mean, "low": mean, "high": mean}]}))


def test_a_study_that_has_just_begun_has_cells_without_curves(folder):
    study = looked(folder)
    assert (study["runs_done"], study["runs_total"], study["episodes_total"]) == (0, 4, 160)
    assert [(cell["contender"], cell["level"], cell["curve"], cell["final"]) for cell in study["cells"]] == [
        ("dqn", "easy", [], None),
        ("ppo", "easy", [], None),
    ]
    assert study["cells"][0]["runs"][0] == {
        "seed": 1,
        "state": "waiting",
        "episodes": 0,
        "reason": "",
        "place": None,
        "final": None,
    }


def test_curves_are_medians_over_seeds(folder, make):
    make("made/runs/dqn-easy-1", [-1.0] * 40)
    make("made/runs/dqn-easy-2", [-0.5] * 20, outcome="stopped")
    scored(folder.evaluation(PlannedRun("dqn", "easy", 1)), -0.25)
    scored(folder.reference("planner", "easy"), -0.05)
    study = looked(folder)
    cell = study["cells"][0]
    assert cell["curve"][0] == [1, -0.75, -1.0, -0.5, 2]
    assert cell["curve"][-1] == [40, -1.0, -1.0, -1.0, 1]
    assert cell["final"] == {"median": -0.25, "low": -0.25, "high": -0.25, "runs": 1}
    assert [(run["state"], run["episodes"], run["place"]) for run in cell["runs"]] == [
        ("done", 40, "made/runs/dqn-easy-1"),
        ("waiting", 20, "made/runs/dqn-easy-2"),
    ]
    assert study["references"]["easy"]["planner"]["mean"] == -0.05


def test_a_study_that_cannot_be_read_is_said_so(folder):
    folder.study_file.write_text("contenders: []\n")
    assert "contenders" in looked(folder)["wrong"]


@pytest.mark.parametrize("text", ["-0.25", "0.0", "-1e-05", "1.0"])
def test_returns_are_found_in_rows(text):
    assert return_of(f'{{"episode":0,"return":{text},"arrived":1}}'.encode()) == float(text)


def test_a_row_without_a_return_is_none():
    with pytest.raises(ValueError, match="no return"):
        return_of(b'{"episode":0}')
