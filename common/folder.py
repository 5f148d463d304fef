"""Where everything of a run lies."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.bus import NoAnswer
from common.config import RunConfig, parse_config
from common.mapping_file import read_mapping
from common.rules.settings import DEMONSTRATIONS_FILE, START_FILE
from common.sessions import Door
from common.strict import ConfigError
from common.tls import Credentials


@dataclass(frozen=True)
class RunFolder:
    """The folder of a run; relative paths are the user's, so they show up as given."""

    path: Path

    @property
    def config_file(self) -> Path:
        return self.path / "config.yaml"

    @property
    def episodes_file(self) -> Path:
        return self.path / "episodes.jsonl"

    @property
    def evaluations_file(self) -> Path:
        return self.path / "evaluations.jsonl"

    @property
    def metrics_file(self) -> Path:
        return self.path / "metrics.jsonl"

    @property
    def tensorboard(self) -> Path:
        return self.path / "tensorboard"

    @property
    def checkpoints(self) -> Path:
        return self.path / "checkpoints"

    @property
    def snapshots(self) -> Path:
        return self.path / "snapshots"

    @property
    def start_file(self) -> Path:
        """The run's copy of the checkpoint that it begins with, if it does."""
        return self.path / START_FILE

    @property
    def demonstrations_file(self) -> Path:
        """The run's copy of the demonstrations that its replay begins with, if it does."""
        return self.path / DEMONSTRATIONS_FILE

    @property
    def board_file(self) -> Path:
        return self.path / "weights.board"

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    @property
    def processes(self) -> Path:
        return self.path / "processes"

    @property
    def cluster_file(self) -> Path:
        return self.path / "cluster.json"

    def wants_actors(self) -> bool:
        """There are to be some, as the supervisor knows it; else the learner acts itself."""
        try:
            return any(json.loads(self.cluster_file.read_text())["actors"].values())
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return True  # nobody has said that there are to be none

    @property
    def outcome_file(self) -> Path:
        return self.path / "outcome.json"

    @property
    def curve_file(self) -> Path:
        return self.path / "curve.png"

    @property
    def paused_file(self) -> Path:
        return self.path / "paused"

    def config(self) -> RunConfig:
        """The run's checked configuration.

        Raises:
            ConfigError: the file is missing or wrong.
        """
        data = read_mapping(self.config_file, "restore it, or start another run", "algorithm: dddqn")
        try:
            return parse_config(data)
        except ConfigError as error:
            raise ConfigError(f"{self.config_file}: {error}") from None

    def endpoint_and_namespace(self) -> tuple[str, str]:
        """Where the run's router listens, and the run's key prefix.

        Raises:
            NoAnswer: the run was never started.
        """
        cluster = self._cluster()
        return str(cluster["endpoint"]), str(cluster["namespace"])

    def credentials(self) -> Credentials | None:
        """Of the processes here, if the run's router is on another machine; raises as `endpoint_and_namespace`."""
        keys = self._cluster().get("keys")
        return None if keys is None else Credentials(Path(keys), "actor")

    def door(self) -> Door | None:
        """Where the run's router lets other machines in, if it does."""
        cluster = self.config().cluster
        if cluster.listen is None or cluster.keys is None:
            return None
        return Door(cluster.listen, self.endpoint_and_namespace()[1], Credentials(Path(cluster.keys), "host"))

    def _cluster(self) -> dict[str, Any]:
        try:
            cluster: dict[str, Any] = json.loads(self.cluster_file.read_text())
            cluster["endpoint"], cluster["namespace"]
        except (OSError, ValueError, KeyError, TypeError):
            raise NoAnswer(f"run {self.path.name} has no cluster: start one with railctl up") from None
        return cluster


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace a file in one step, so that nobody ever reads half of it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    temporary.replace(path)
