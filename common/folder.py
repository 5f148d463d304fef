"""Where everything of a run lies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from railctl.common.bounded import read_json
from railctl.common.bus import NoAnswer
from railctl.common.config import MAX_ACTORS, RunConfig, parse_config
from railctl.common.levels.distributions import LevelName
from railctl.common.mapping_file import read_mapping
from railctl.common.rules.settings import DEMONSTRATIONS_FILE, START_FILE
from railctl.common.sessions import Door
from railctl.common.strict import ConfigError, Strict
from railctl.common.tls import Credentials
from railctl.common.whole import write_whole

Word = Annotated[str, Field(pattern=r"^\S+$", max_length=200)]


class Cluster(Strict):
    """What `cluster.json` says; whoever starts the run makes what it lacks.

    Attributes:
        endpoint: where the run's router listens.
        namespace: the run's key prefix.
        actors: how many there are to be, by what they serve.
        keys: the folder of the credentials of processes here, if the router is on another machine.
    """

    endpoint: Word | None = None
    namespace: Word | None = None
    actors: dict[LevelName, Annotated[int, Field(ge=0, le=MAX_ACTORS)]] | None = None
    keys: Annotated[str, Field(min_length=1, max_length=4096)] | None = None


class Outcome(Strict):
    """How a run ended, and why it did if nobody asked for it: `outcome.json`."""

    outcome: Literal["finished", "stopped", "failed"]
    reason: str


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
    def events_file(self) -> Path:
        return self.path / "events.jsonl"

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
        counts = self.cluster().actors
        return counts is None or any(counts.values())  # unless somebody has said that there are to be none

    def cluster(self) -> Cluster:
        """What `cluster.json` says: nothing, if it is not there, or damaged; `railctl up` makes it anew."""
        try:
            return Cluster.model_validate(read_json(self.cluster_file))
        except (OSError, ValueError):
            return Cluster()

    @property
    def outcome_file(self) -> Path:
        return self.path / "outcome.json"

    def outcome(self) -> Outcome | None:
        """How the run ended; None: `outcome.json` is not there, or damaged."""
        try:
            return Outcome.model_validate(read_json(self.outcome_file))
        except (OSError, ValueError):
            return None

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
        cluster = self.cluster()
        if cluster.endpoint is None or cluster.namespace is None:
            raise NoAnswer(f"run {self.path.name} has no cluster: start one with railctl up")
        return cluster.endpoint, cluster.namespace

    def credentials(self) -> Credentials | None:
        """Of the processes here, if the run's router is on another machine."""
        keys = self.cluster().keys
        return None if keys is None else Credentials(Path(keys), "actor")

    def door(self) -> Door | None:
        """Where the run's router lets other machines in, if it does; raises as `endpoint_and_namespace`."""
        cluster = self.config().cluster
        if cluster.listen is None or cluster.keys is None:
            return None
        return Door(cluster.listen, self.endpoint_and_namespace()[1], Credentials(Path(cluster.keys), "host"))


def numbered(folder: Path) -> list[Path]:
    """A run's own snapshots or checkpoints, the newest last; a user may keep others beside them."""
    return sorted(
        (path for path in folder.glob("*.safetensors") if path.stem.isdecimal()), key=lambda path: int(path.stem)
    )


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace a file in one step, so that nobody ever reads half of it, whatever ends: a process, or the power."""
    write_whole(path, content.encode() if isinstance(content, str) else content)
