"""railctl mirror: a run's rows in a real store of MLflow, each number once."""

import os
import sys
from pathlib import Path

import pytest
from command_line import complaint, railctl
from made_rows import episode_row
from mlflow.tracking import MlflowClient

from railctl.common.folder import Outcome
from railctl.common.records.rows import EpisodeRow, EvaluationRow, MetricRow
from railctl.common.rows import RowFile
from railctl.deploy.commands import mirror as command
from railctl.deploy.launch import new_run
from railctl.deploy.mirror.following import Follower, alone
from railctl.deploy.mirror.mlflow_sink import MlflowSink
from railctl.deploy.mirror.points import points_of
from railctl.deploy.resolve import resolve

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # MLflow's own, of its store

EVALUATION = {
    "episode": 4,
    "level": "easy",
    "mode": "greedy",
    "levels": 50,
    "normalised_return": -0.25,
    "arrived_share": 0.75,
    "all_arrived_share": 0.5,
    "mean_steps": 100.0,
    "weights_digest": "0" * 32,
    "evaluated_unix_s": 2000.0,
    "evaluating_s": 1.0,
}


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A run that has four episodes."""
    monkeypatch.setenv("RAILCTL_RUNS", "runs")
    monkeypatch.chdir(tmp_path)
    folder = new_run("one", resolve({"episodes": 10, "cluster": {"cores": 1}}))
    append(folder, range(4))
    return folder


def store():
    """The address of the test's own: MLflow keeps open what it knows by an address."""
    return f"sqlite:///{Path.cwd()}/store.db"


def append(folder, numbers):
    """Episodes of these numbers, with their metrics."""
    episodes, metrics = RowFile(folder.episodes_file, EpisodeRow), RowFile(folder.metrics_file, MetricRow)
    for number in numbers:
        episodes.append(episode_row(number, normalised_return=-number / 8, trained_unix_s=1000.0 + number))
        metrics.append(MetricRow(episode=number, metrics={"loss": 2.0 * number}))
    for file in (episodes, metrics):
        file.close()


def evaluate(folder):
    evaluations = RowFile(folder.evaluations_file, EvaluationRow)
    evaluations.append(EvaluationRow(**EVALUATION))
    evaluations.close()


def stored(experiment="railctl"):
    """The one run there, and a function that gives the steps and values of a metric."""
    client = MlflowClient(store())
    [found] = client.search_runs([client.get_experiment_by_name(experiment).experiment_id])
    return found, lambda name: [
        (metric.step, metric.value) for metric in client.get_metric_history(found.info.run_id, name)
    ]


def test_what_was_killed_before_it_had_described_the_run_does_so_the_next_time(run, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(MlflowSink, "_describe", lambda _sink: None)
        MlflowSink(run, store(), "railctl")
    assert stored()[0].data.params == {}
    MlflowSink(run, store(), "railctl")
    assert stored()[0].data.params["algorithm"] == "dddqn"


@pytest.mark.parametrize("uri", ["sqlite://", "sqlite:///", "sqlite:///:memory:"])
def test_a_store_that_would_be_gone_is_refused(run, uri):
    assert "a store in memory ends with this command" in complaint(2, "mirror", "one", "--mlflow", uri)


@pytest.mark.parametrize("uri", ["mlruns", "./mlruns", "file:///tmp/mlruns"])
def test_a_store_in_a_folder_is_refused(run, uri):
    assert complaint(2, "mirror", "one", "--mlflow", uri) == (
        f"railctl: --mlflow {uri}: MLflow keeps runs in folders no more: name a file, as sqlite:///runs.db"
    )


def test_a_database_without_its_driver_is_one_line(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyodbc", None)
    said = complaint(1, "mirror", "one", "--mlflow", "mssql://there")
    assert said.startswith("railctl: --mlflow mssql://there: ")
    assert said.endswith(": install the driver of its database")


def test_history_and_what_comes_are_there_once_and_so_is_the_configuration(run):
    options = "mirror", "one", "--mlflow", store()
    assert "24 numbers brought there" in railctl(*options).stdout  # of 4 episodes 5 each, and a metric
    append(run, range(4, 6))
    evaluate(run)
    run.outcome_file.write_text(Outcome(outcome="finished", reason="").model_dump_json())
    assert railctl(*options).exit_code == 0
    assert railctl(*options).stdout.splitlines()[-1] == "0 numbers brought there"
    found, history = stored()
    assert history("training/return") == [(number, -number / 8) for number in range(6)]
    assert history("learning/loss") == [(number, 2.0 * number) for number in range(6)]
    assert history("evaluation/easy/return") == [(4, -0.25)]
    assert (found.info.run_name, found.info.status) == ("one", "FINISHED")
    assert (found.data.params["algorithm"], found.data.params["network.kind"]) == ("dddqn", "dueling")


def test_what_a_mirror_left_half_done_is_made_whole(run):
    """It was killed after a batch: the store has some numbers of a row, and not others."""
    first = MlflowSink(run, store(), "railctl")
    rows = [episode_row(number, normalised_return=-number / 8) for number in range(2)]
    for point in [*points_of(rows[0], 0.0), *list(points_of(rows[1], 0.0))[:1]]:
        first.add(point)
    first.flush()
    second = MlflowSink(run, store(), "railctl")
    assert second.run_id == first.run_id
    Follower(run).bring(second)
    _, history = stored()
    assert history("training/return") == [(number, -number / 8) for number in range(4)]
    assert [step for step, _ in history("training/steps")] == [0, 1, 2, 3]


def test_a_living_run_is_followed_until_it_ends(run, monkeypatch):
    """What comes between two looks is brought with the next, what comes before the end with the last."""
    lives = iter([{"learner": 1}, {"learner": 1}, {}])
    monkeypatch.setattr("railctl.deploy.mirror.following.living", lambda _folder: next(lives))
    coming = iter([range(4, 5), range(5, 7)])
    points = []

    class Sink:
        add = staticmethod(points.append)
        flush = staticmethod(lambda: None)

    Follower(run).follow(Sink(), wait=lambda _s: append(run, next(coming)))
    assert [point.episode for point in points if point.name == "training/return"] == list(range(7))


def test_two_mirrors_of_a_run_would_bring_numbers_twice(run):
    with alone(run):
        said = complaint(1, "mirror", "one", "--mlflow", store())
    assert said == "railctl: run one is being mirrored already: end that railctl mirror first"


def test_what_is_missing_or_wrong_is_one_line(run, monkeypatch):
    assert complaint(2, "mirror", "two").startswith("railctl: no run named 'two'")
    said = complaint(1, "mirror", "one", "--mlflow", "nosuch://there")
    assert said.startswith("railctl: --mlflow nosuch://there: ")
    assert "there is no folder /no/such: make it" in complaint(
        2, "mirror", "one", "--mlflow", "sqlite:////no/such/a.db"
    )
    assert f"{run.path} is a folder: name a file" in complaint(2, "mirror", "one", "--mlflow", f"sqlite:///{run.path}")
    (run.path / "text.db").write_text("no database" * 99)
    said = complaint(1, "mirror", "one", "--mlflow", f"sqlite:///{run.path}/text.db")
    assert said.endswith("text.db: (sqlite3.DatabaseError) file is not a database")
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda _path, _mode: False)  # root may write anywhere
        said = complaint(1, "mirror", "one", "--mlflow", f"sqlite:///{run.path}/a.db")
        assert f"{run.path} cannot be written: give a file in another folder" in said
    monkeypatch.setattr(command, "find_spec", lambda _name: None)
    assert complaint(1, "mirror", "one") == "railctl: the package mlflow is missing: pip install 'railctl[mlflow]'"
