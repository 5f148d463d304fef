"""Runs that lie in a folder, and a page over them that needs no browser."""

import pytest
from made_rows import episode_row
from served_page import Served

from railctl.common.folder import Outcome, RunFolder
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.common.rows import RowFile
from railctl.deploy.launch import save_config
from railctl.deploy.resolve import resolve

HERE = "http://127.0.0.1:8710"


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    (tmp_path / "runs").mkdir()
    return tmp_path / "runs"


def write_rows(path, record_type, rows):
    file = RowFile(path, record_type)
    for row in rows:
        file.append(row)
    file.close()


@pytest.fixture
def make(root):
    """Makes a run that has ended after some episodes."""

    def make_run(name, returns=(), evaluations=(), outcome="finished", **given):
        folder = RunFolder(root / name)
        folder.path.mkdir(parents=True)
        folder.checkpoints.mkdir()
        save_config(folder, resolve({"episodes": 40} | given))
        rows = [episode_row(number, normalised_return=value) for number, value in enumerate(returns)]
        write_rows(folder.episodes_file, EpisodeRow, rows)
        write_rows(folder.evaluations_file, EvaluationRow, evaluations)
        if outcome is not None:
            folder.outcome_file.write_text(Outcome(outcome=outcome, reason="").model_dump_json())
        return folder

    return make_run


@pytest.fixture
def serve(root):
    """Serves pages over the runs there are."""
    served = []

    def serve_page(*names, **options):
        served.append(Served(*names, **options))
        return served[-1]

    yield serve_page
    for page in served:
        page.end()


@pytest.fixture
def asking(serve):
    return serve()
