"""How far a study is, from folders made by hand; and what is expected of the rest."""

import json

import pytest

from railctl.analysis.study import FinalEvaluation, PlannedRun, Study, StudyFolder
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.deploy.study.described import save_study
from railctl.deploy.study.estimate import (
    BESIDE_S,
    SCORING_STARTS_S,
    STARTING_S,
    Rate,
    measured,
    run_seconds,
    seconds_left,
)
from railctl.deploy.study.progress import Looking, status_document

STUDY = Study.model_validate(
    {
        "name": "made",
        "contenders": ["dqn", "ppo"],
        "levels": ["easy"],
        "seeds": [1, 2],
        "episodes": 30,
        "evaluation": {"episodes": 100},
        "references": ["planner"],
        "judgement": {"block": 10},
    }
)
RATES = {
    ("dqn", "easy"): Rate(episode_s=2.0, level_s=0.01, run_bytes=10, source="run", episodes=30),
    ("ppo", "easy"): Rate(episode_s=1.0, level_s=0.03, run_bytes=20, source="run", episodes=30),
}


@pytest.fixture
def folder(tmp_path):
    folder = StudyFolder(tmp_path / "made")
    save_study(folder, STUDY)
    return folder


def test_a_study_that_has_only_been_saved_waits(folder):
    progress = Looking(folder, STUDY).look()
    assert (progress.count("waiting"), progress.episodes, progress.failures) == (4, 0, {})
    assert progress.references == {("planner", "easy"): False}


def test_every_state_is_told_from_the_folder(folder, made_run):
    runs = [PlannedRun(name, "easy", seed) for seed in (1, 2) for name in ("dqn", "ppo")]
    made_run(folder, STUDY, runs[0], 30, "finished")
    folder.evaluation(runs[0]).write_text("{}")
    made_run(folder, STUDY, runs[1], 30, "finished")
    running = made_run(folder, STUDY, runs[2], 12)
    made_run(folder, STUDY, runs[3], 7, "failed")
    with sole(RunFolder(running.path), "supervisor"):
        progress = Looking(folder, STUDY).look()
    assert [run.state for run in progress.runs] == ["done", "trained", "running", "failed"]
    assert [run.episodes for run in progress.runs] == [30, 30, 12, 7]
    assert progress.failures == {"ppo-easy-2": "why"}
    document = status_document(folder, progress, 5.0)
    assert document["cells"][0] == {
        "contender": "dqn",
        "level": "easy",
        "episodes": 42,
        "done": 1,
        "running": 1,
        "trained": 0,
        "waiting": 0,
        "failed": 0,
    }
    assert (document["process"], document["report"], document["episodes_total"]) == (None, None, 120)


def test_a_stopped_run_waits_with_what_it_has(folder, made_run):
    made_run(folder, STUDY, PlannedRun("dqn", "easy", 1), 12, "stopped")
    made_run(folder, STUDY, PlannedRun("ppo", "easy", 1), 3)  # its supervisor was killed
    assert [(run.state, run.episodes) for run in Looking(folder, STUDY).look().runs][:2] == [
        ("waiting", 12),
        ("waiting", 3),
    ]


def test_damaged_rows_are_a_failure_with_its_reason(folder, made_run):
    place = made_run(folder, STUDY, PlannedRun("dqn", "easy", 1), 12)
    place.episodes_file.write_text("nonsense\n")
    [reason] = Looking(folder, STUDY).look().failures.values()
    assert f"{place.episodes_file} line 1 is not a valid row" in reason


def test_what_is_done_is_read_once(folder, made_run):
    looking, run = Looking(folder, STUDY), PlannedRun("dqn", "easy", 1)
    place = made_run(folder, STUDY, run, 30, "finished")
    folder.evaluation(run).write_text("{}")
    assert looking.look().count("done") == 1
    place.outcome_file.unlink()
    assert looking.look().count("done") == 1


def test_rates_are_those_of_a_run_that_is_over_or_of_the_short_one(folder, made_run):
    short = {"made_of": "", "episode_s": 1.0, "episodes": 5, "fragments": 10, "level_s": 0.2, "run_bytes": 7}
    folder.calibration.write_text(json.dumps({f"{name}-easy-1": short for name in ("dqn", "ppo")}))
    over = made_run(folder, STUDY, PlannedRun("ppo", "easy", 2), 30, "finished")
    made_run(folder, STUDY, PlannedRun("dqn", "easy", 2), 20, "stopped")  # is not over
    rates = measured(folder, Looking(folder, STUDY).look())
    rows = over.episodes_file.stat().st_size  # nothing else was made
    assert rates == {
        ("dqn", "easy"): Rate(1.0 + 10 * BESIDE_S, 0.2, 7, "calibration", 5),
        ("ppo", "easy"): Rate(2.0, 0.1, rows, "run", 30),
    }


def test_figures_that_cannot_be_read_are_none(folder):
    folder.calibration.write_text('{"dqn-easy-1": {"episode_s": "fast"}}')
    assert measured(folder, Looking(folder, STUDY).look()) == {}


def test_of_what_was_never_measured_nothing_is_known(folder):
    progress = Looking(folder, STUDY).look()
    assert measured(folder, progress) == {}
    assert seconds_left(progress, {}, cores=2) is None


def test_what_is_left_is_shared_by_the_cores(folder, made_run):
    final = FinalEvaluation(episodes=100)
    overhead = STARTING_S + SCORING_STARTS_S
    assert run_seconds(RATES, STUDY) == {("dqn", "easy"): overhead + 60 + 1, ("ppo", "easy"): overhead + 30 + 3}
    assert (
        seconds_left(Looking(folder, STUDY).look(), RATES, cores=2) == (2 * (overhead + 61) + 2 * (overhead + 33)) / 2
    )
    made_run(folder, STUDY, PlannedRun("dqn", "easy", 1), 30, "finished")
    folder.evaluation(PlannedRun("dqn", "easy", 1)).write_text("{}")
    made_run(folder, STUDY, PlannedRun("ppo", "easy", 1), 30, "finished")
    made_run(folder, STUDY, PlannedRun("dqn", "easy", 2), 20, "stopped")
    progress = Looking(folder, STUDY).look()
    scoring = SCORING_STARTS_S + 3
    stopped, whole = overhead + 10 * 2 + 1, overhead + 30 + 3
    assert RATES["ppo", "easy"].scoring_s(final) == scoring
    assert seconds_left(progress, RATES, cores=1) == scoring + stopped + whole
    assert seconds_left(progress, RATES, cores=8) == whole  # no faster than the longest
    of_dqn = {("dqn", "easy"): RATES["dqn", "easy"]}
    assert seconds_left(progress, of_dqn, cores=1) == stopped + 2 * (overhead + 61)  # of ppo nothing is known
