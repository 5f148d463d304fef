"""A run in MLflow: configuration as parameters, rows as metrics, each number once however often one begins anew.

What is in the store already is asked of the store itself, number by number: whoever goes on after a crash, between two
batches or within one, finds out what is missing. Nothing is kept beside it.
"""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from mlflow.entities import Metric, Param
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient
from sqlalchemy.exc import SQLAlchemyError

from railctl.common.folder import RunFolder
from railctl.common.strict import brief, flat
from railctl.deploy.mirror.points import Point
from railctl.deploy.runs import Failed

MOST_AT_ONCE, LONGEST_VALUE = 500, 500
PARAMS_AT_ONCE = 100
LONGEST_REASON = 300  # characters
RETRIES = "MLFLOW_HTTP_REQUEST_MAX_RETRIES"
RUN, NAMESPACE = "railctl.run", "railctl.namespace"  # tags by which a run is found again
UNUSABLE = (MlflowException, SQLAlchemyError, OSError)  # what a store may say
Ending = Literal["FINISHED", "KILLED", "FAILED"]


class MlflowSink:
    """The run of MLflow that stands for one of ours.

    Attributes:
        run_id: its name in MLflow.
        logged: numbers that were brought there by this object.
    """

    def __init__(self, folder: RunFolder, uri: str, experiment: str) -> None:
        """Find the run in the store of an address, or begin it.

        Raises:
            Failed: the store cannot be used.
        """
        self.run_id, self.logged = "", 0
        self._there: dict[str, set[int]] = {}  # episodes of each name in the store
        self._waiting: list[Metric] = []
        self._folder, self._uri = folder, uri
        logging.getLogger("mlflow").setLevel(logging.WARNING)  # it tells of every table that it makes
        try:
            self._client = MlflowClient(uri)
            with _impatient():
                found = self._client.get_experiment_by_name(experiment)
            number = found.experiment_id if found else self._client.create_experiment(experiment)
            self.run_id = self._found(number) or self._begun(number)
            self._describe()
            self._client.update_run(self.run_id, status="RUNNING")
        except ImportError as error:
            raise Failed(f"--mlflow {uri}: {error}: install the driver of its database") from None
        except UNUSABLE as error:
            raise self._failed(error) from None

    def add(self, point: Point) -> None:
        """Bring a number there, if it is not; soon."""
        if point.name not in self._there:
            self._there[point.name] = self._history(point.name)
        if point.episode in self._there[point.name]:
            return
        self._there[point.name].add(point.episode)
        self._waiting.append(Metric(point.name, point.value, round(1000 * point.unix_s), point.episode))
        if len(self._waiting) >= MOST_AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Bring there what waits; raises Failed."""
        if self._waiting:
            try:
                self._client.log_batch(self.run_id, metrics=self._waiting)
            except UNUSABLE as error:
                raise self._failed(error) from None
            self.logged += len(self._waiting)
            self._waiting = []

    def end(self, ending: Ending) -> None:
        """Say that the run has ended; with its picture, if the store takes files."""
        self.flush()
        try:
            if self._folder.curve_file.exists():
                self._client.log_artifact(self.run_id, str(self._folder.curve_file))
            self._client.set_terminated(self.run_id, status=ending)
        except UNUSABLE as error:
            raise self._failed(error) from None

    def _found(self, experiment: str) -> str | None:
        tags = self._tags()
        wanted = " and ".join(f"tags.`{name}` = '{value}'" for name, value in tags.items())
        runs = self._client.search_runs([experiment], wanted, max_results=1)
        return runs[0].info.run_id if runs else None

    def _begun(self, experiment: str) -> str:
        run: Any = self._client.create_run(experiment, tags=self._tags(), run_name=self._folder.path.name)
        return str(run.info.run_id)

    def _describe(self) -> None:
        """Bring there what is missing of the configuration; who began the run may have been killed before."""
        there = self._client.get_run(self.run_id).data.params
        given = flat(self._folder.config().plain())
        params = [Param(name, str(value)[:LONGEST_VALUE]) for name, value in given.items() if name not in there]
        for first in range(0, len(params), PARAMS_AT_ONCE):
            self._client.log_batch(self.run_id, params=params[first : first + PARAMS_AT_ONCE])
        if params or not self._client.list_artifacts(self.run_id):
            self._client.log_artifact(self.run_id, str(self._folder.config_file))

    def _tags(self) -> dict[str, str]:
        """A run that was begun anew under the same name has another namespace."""
        return {RUN: self._folder.path.name, NAMESPACE: self._folder.cluster().namespace or "none"}

    def _history(self, name: str) -> set[int]:
        try:
            return {metric.step for metric in self._client.get_metric_history(self.run_id, name)}
        except UNUSABLE as error:
            raise self._failed(error) from None

    def _failed(self, error: Exception) -> Failed:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        return Failed(f"--mlflow {self._uri}: {brief(reason, LONGEST_REASON)}")


@contextmanager
def _impatient() -> Iterator[None]:
    """Who is not there at the start is not worth minutes; later a server may be started anew."""
    if RETRIES in os.environ:
        yield
        return
    os.environ[RETRIES] = "1"
    try:
        yield
    finally:
        del os.environ[RETRIES]
