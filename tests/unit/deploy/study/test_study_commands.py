"""railctl study, from the command line to the folder, as far as nothing has to be trained."""

import io
import json
from types import SimpleNamespace

import pytest
import yaml
from rich.console import Console
from typer.testing import CliRunner

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.common.interpreter import PYTHON
from railctl.common.locks import sole
from railctl.deploy import task
from railctl.deploy.cli import app
from railctl.deploy.study import calibration
from railctl.deploy.study.calibration import REST_BYTES, ROWS_BYTES
from railctl.deploy.study.described import configurations, save_study
from railctl.deploy.study.dispatcher import Dispatcher, Ended
from railctl.deploy.study.estimate import BESIDE_S, SCORING_STARTS_S, STARTING_S
from railctl.deploy.study.levels import missing_levels
from railctl.deploy.study.runner import Runner
from railctl.deploy.study.view import StudyView

GIVEN = {
    "name": "made",
    "contenders": ["dqn"],
    "levels": ["easy"],
    "seeds": [1, 2],
    "episodes": 30,
    "evaluation": {"episodes": 60},
    "references": ["planner"],
    "judgement": {"block": 10},
}
STUDY = Study.model_validate(GIVEN)
FIRST, SECOND = PlannedRun("dqn", "easy", 1), PlannedRun("dqn", "easy", 2)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "200")
    folder = StudyFolder(tmp_path / "made")
    save_study(folder, STUDY)
    return folder


@pytest.fixture
def railctl():
    def run(*arguments, code=0):
        result = CliRunner().invoke(app, ["study", *arguments])
        assert result.exit_code == code, result.output
        return result.stdout if code == 0 else result.stderr

    return run


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["run", "thesis", "--cores", "0"], "--cores 0: this machine offers "),
        (["run", "thesi"], "no study named 'thesi': did you mean thesis?"),
        (["run", "thesis", "--name", "a b"], "--name 'a b': use letters"),
        (["plan", "nothing.yaml"], "nothing.yaml cannot be read: No such file or directory"),
        (["status", "thesis"], "study thesis has not been started in "),
        (["report", "mad"], "no study named 'mad': did you mean made? known are dispatch, interlocking, made, "),
    ],
)
def test_wrong_usage_is_one_line(folder, railctl, arguments, text):
    said = railctl(*arguments, code=2)
    assert said.startswith(f"railctl: {text}")
    assert len(said.splitlines()) == 1


def test_a_changed_study_is_refused_before_anything_is_done(folder, railctl, tmp_path):
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump(GIVEN | {"seeds": [1]}))
    assert "study made was started with seeds [1, 2], not [1]" in railctl("run", str(path), code=2)
    assert not folder.runs.exists() or not list(folder.runs.iterdir())


def test_one_command_works_on_a_study_at_a_time(folder, railctl):
    with sole(folder, "study"):
        assert "works on study made already: railctl study status made shows it" in railctl("run", "made", code=1)
        assert "works on study made already" in railctl("plan", "made", code=1)
        assert json.loads(railctl("status", "made", "--json"))["process"]


def test_a_plan_adds_up(folder, railctl, made_run, tmp_path):
    made_run(folder, STUDY, FIRST, 30, "finished")
    document = json.loads(railctl("plan", "made", "--cores", "1", "--json"))
    [cell] = document["cells"]
    assert (cell["episode_s"], cell["measured_on"]) == (2.0, "run")
    assert cell["run_s"] == pytest.approx(STARTING_S + 30 * 2 + SCORING_STARTS_S + 60 * 0.1)
    to_score = SCORING_STARTS_S + 60 * 0.1  # the run that is trained already
    assert document["expected_s"] == pytest.approx(cell["run_s"] + to_score)
    assert document["disk_bytes"] == 2 * cell["run_bytes"]
    assert document["levels_to_generate"] == {"easy": 2 * 30 + 60}
    said = railctl("plan", "made", "--cores", "1")
    assert "made: 1 contenders x 1 levels x 2 seeds = 2 runs of 30 episodes, 0 done" in said
    assert "levels to generate: 120 easy" in said
    assert "expected: 1:23 on 1 cores" in said
    assert "dqn" in said


def test_levels_of_another_evaluation_sequence_are_not_banked(folder, tmp_path):
    other = STUDY.model_copy(update={"evaluation": STUDY.evaluation.model_copy(update={"seed": 1})})
    assert missing_levels(other, configurations(other, 1), tmp_path / "bank") == {"easy": 2 * 30 + 50}


def test_status_shows_what_there_is(folder, railctl, made_run):
    made_run(folder, STUDY, FIRST, 30, "finished")
    folder.evaluation(FIRST).write_text("{}")
    made_run(folder, STUDY, SECOND, 7, "failed")
    lines = railctl("status", "made").splitlines()
    assert lines[0].startswith("made: 1 of 2 runs done, 1 failed, 37 of 60 episodes, 1:00 left")
    assert lines[2].split() == ["dqn", "easy", "1/2", "-", "-", "1", "37"]
    assert lines[3:] == [
        "references: 0 of 1 scored",
        "! dqn-easy-2: why",
        "nobody works on it: railctl study run made goes on",
    ]


MEASURER = """
import json, sys
from pathlib import Path
runs = json.loads(Path(sys.argv[1]).read_text())["runs"]
print(json.dumps({"progress": {}}))
figures = {"episode_s": 1.0, "episodes": 5, "fragments": 2.0, "level_s": 0.1, "checkpoint_bytes": 100}
print(json.dumps({name: figures for name in runs}))
"""


@pytest.fixture
def measurer(monkeypatch):
    """Has another program stand for the one that measures."""

    def use(code=MEASURER):
        monkeypatch.setattr(task, "run_worker", lambda _module, *arguments: [*PYTHON, "-c", code, *arguments])

    use()
    return use


def test_what_was_measured_is_kept_until_the_description_changes(folder, railctl, measurer):
    first = json.loads(railctl("plan", "made", "--cores", "1", "--json"))
    [cell] = first["cells"]
    assert (first["measured_now"], cell["measured_on"], cell["measured_episodes"]) == (1, "calibration", 5)
    assert cell["episode_s"] == pytest.approx(1.0 + 2 * BESIDE_S)
    assert cell["run_bytes"] == 30 * ROWS_BYTES + 100 + REST_BYTES
    measurer("raise SystemExit('measured again')")
    again = railctl("plan", "made", "--cores", "1")
    assert "measured: 0 now, 1 kept from before" in again
    assert "5 episodes" in again
    kept = folder.calibration.read_text()
    folder.calibration.write_text(kept.replace('"made_of": "', '"made_of": "x'))
    assert railctl("plan", "made", "--cores", "1", code=1).endswith("a short run failed: measured again\n")


@pytest.mark.parametrize("change", [{"cores": 2}, {"processor": "another"}, {"dqn": {"batch_size": 8}}])
def test_figures_of_something_else_are_measured_anew(folder, measurer, monkeypatch, change):
    console = Console(file=io.StringIO())
    config = configurations(STUDY, 1)[FIRST]
    assert calibration.measure(folder, {FIRST: config}, 1, console) == {FIRST.name}
    assert calibration.measure(folder, {FIRST: config}, 1, console) == set()
    if "processor" in change:
        monkeypatch.setattr(calibration, "processor", lambda: change["processor"])
    if "dqn" in change:
        config = configurations(STUDY.model_copy(update={"settings": change}), 1)[FIRST]
    assert calibration.measure(folder, {FIRST: config}, change.get("cores", 1), console) == {FIRST.name}


class Heard:
    """A view that keeps what it is told."""

    def __init__(self):
        self.ends = []

    def show(self, mind):
        pass

    def ended(self, _job, event):
        self.ends.append(event)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda run: run.config_file.unlink(), "config.yaml cannot be read: No such file or directory"),
        (
            lambda run: run.config_file.write_text(run.config_file.read_text().replace("seed: 1", "seed: 9")),
            "config.yaml is not what the study says: delete ",
        ),
    ],
)
def test_a_run_that_is_not_the_studys_is_a_failure(folder, made_run, tmp_path, spoil, reason):
    spoil(made_run(folder, STUDY, FIRST, 5))
    heard = Heard()
    runner = Runner(folder, STUDY, configurations(STUDY, 1), [FIRST], tmp_path / "bank", heard)
    runner.run(SimpleNamespace(asked=False, wait=lambda _seconds: None))
    assert [event.outcome for event in heard.ends] == ["failed"]
    assert reason in runner.mind.failures[FIRST]


def test_what_is_finished_is_not_run_again(folder, made_run, tmp_path):
    made_run(folder, STUDY, FIRST, 30, "finished")
    heard = Heard()
    runner = Runner(folder, STUDY, configurations(STUDY, 1), [FIRST], tmp_path / "bank", heard)
    runner.run(SimpleNamespace(asked=False, wait=lambda _seconds: None))
    assert (heard.ends, runner.mind.states) == ([], {FIRST: "done"})


@pytest.mark.parametrize("terminal", [True, False])
def test_the_view_says_what_is_done_and_what_goes_on(folder, made_run, terminal):
    made_run(folder, STUDY, FIRST, 30, "finished")
    output = io.StringIO()
    console = Console(file=output, force_terminal=terminal, width=120, highlight=False)
    mind = Dispatcher([FIRST, SECOND], cores=1)
    mind.on(Ended(FIRST, "done"))
    mind.states[SECOND] = "running"
    with StudyView(folder, STUDY, 1, console) as view:
        view.ended(FIRST, Ended(FIRST, "done"))
        view.show(mind)
        view.ended(SECOND, Ended(SECOND, "failed", "no disk"))
    shown = output.getvalue()
    assert "dqn-easy-1: trained" in shown
    assert "0 of 2 runs done, 30 of 60 episodes" in shown
    assert ("dqn-easy-2  0/30 episodes" if terminal else "; now dqn-easy-2") in shown
    assert ("waiting" in shown) is terminal
    assert "dqn-easy-2: no disk" in shown
