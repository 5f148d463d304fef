"""railctl mirror: a run's rows in MLflow, those that are there and those that come."""

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.strict import ConfigError
from railctl.deploy.follow import outcome_of
from railctl.deploy.mirror.following import Follower, alone
from railctl.deploy.output import RunName, check_folder_of, console, counted, one_line_errors
from railctl.deploy.runs import Failed, find_run

NEEDS = "mlflow"
FILE = "sqlite:///"  # and the path


@one_line_errors
def mirror(
    run: RunName = None,
    mlflow: Annotated[
        str, typer.Option(metavar="URI", help="The store: sqlite:///FILE.db, or http:// of a tracking server.")
    ] = "sqlite:///mlflow.db",
    experiment: Annotated[str, typer.Option(help="The experiment that the run belongs to there.")] = "railctl",
) -> None:
    """Bring a run's configuration and rows to MLflow, with full history, and follow it until it ends.

    What is there already is not brought again: end it and start it as you like.
    """
    folder = find_run(run)
    if mlflow.rstrip("/") == "sqlite:" or ":memory:" in mlflow:
        raise ConfigError(
            f"--mlflow {mlflow}: a store in memory ends with this command: name a file, as sqlite:///runs.db"
        )
    is_place = "://" in mlflow or mlflow == "databricks"
    if mlflow.startswith("file:") or not is_place:  # MLflow would answer with a paragraph
        raise ConfigError(f"--mlflow {mlflow}: MLflow keeps runs in folders no more: name a file, as sqlite:///runs.db")
    if mlflow.startswith(FILE):  # MLflow would make folders, or try again for minutes
        store = Path(mlflow.removeprefix(FILE)).absolute()
        check_folder_of(store, f"--mlflow {mlflow}")
        if store.is_dir():
            raise ConfigError(f"--mlflow {mlflow}: {store} is a folder: name a file")
        for path in (store.parent, store) if store.exists() else (store.parent,):
            if not os.access(path, os.R_OK | os.W_OK):
                raise Failed(f"--mlflow {mlflow}: {path} cannot be written: give a file in another folder")
    if find_spec(NEEDS) is None:
        raise Failed(f"the package {NEEDS} is missing: pip install 'railctl[mlflow]'")
    with alone(folder):
        _mirror(folder, mlflow, experiment)


def _mirror(folder: RunFolder, uri: str, experiment: str) -> None:
    from railctl.deploy.mirror.mlflow_sink import MlflowSink  # noqa: PLC0415  (it takes seconds)

    sink = MlflowSink(folder, uri, experiment)
    name = folder.path.name
    console.print(f"run {name} is run {sink.run_id} of {experiment} in {uri}", markup=False, soft_wrap=True)
    try:
        Follower(folder).follow(sink)
        if not living(folder):
            outcome = outcome_of(folder)[0]
            sink.end("FINISHED" if outcome == "finished" else "FAILED" if outcome == "failed" else "KILLED")
    except KeyboardInterrupt:
        sink.flush()
    console.print(f"{counted(sink.logged, 'number')} brought there", markup=False, soft_wrap=True)
