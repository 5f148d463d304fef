"""Every key of a run, relative to the run's namespace. A channel ties its key to the records that travel on it."""

from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from common import records
from common.records import Record

A = TypeVar("A", bound=Record)
B = TypeVar("B", bound=Record)


@dataclass(frozen=True)
class Topic(Generic[A]):
    """Publish and subscribe."""

    key: str
    record: type[A]


@dataclass(frozen=True)
class Service(Generic[A, B]):
    """Ask and answer."""

    key: str
    request: type[A]
    answer: type[B]


EPISODES = Topic("episodes", records.Episode)
WEIGHTS = Topic("weights", records.Weights)
EPISODE_ROWS = Topic("rows/episodes", records.EpisodeRow)
EVALUATION_ROWS = Topic("rows/evaluations", records.EvaluationRow)
CHECKPOINTS = Topic("checkpoints", records.CheckpointNotice)
HEARTBEATS = Topic("heartbeats", records.Heartbeat)

LEASE = Service("lease", records.LeaseRequest, records.LeaseAnswer)
PULL_WEIGHTS = Service("pull/weights", records.WeightsRequest, records.Weights)
LIST_CHECKPOINTS = Service("list/checkpoints", records.Empty, records.CheckpointNotice)
PULL_CHECKPOINT = Service("pull/checkpoint", records.CheckpointRequest, records.CheckpointFile)
EPISODE_HISTORY = Service("history/episodes", records.HistoryRequest, records.EpisodeRows)
EVALUATION_HISTORY = Service("history/evaluations", records.HistoryRequest, records.EvaluationRows)
COMMAND_LEARNER = Service("command/learner", records.LearnerCommand, records.CommandAnswer)
STATUS = Service("command/status", records.Empty, records.Status)
SCALE = Service("command/scale", records.ScaleRequest, records.CommandAnswer)
STOP = Service("command/stop", records.Empty, records.CommandAnswer)

ALL_ALIVE = "alive/*/*/*"


class Alive(NamedTuple):
    """The liveliness token of one incarnation of a process.

    >>> Alive("actor", "actor-easy-0", "9f3c").key
    'alive/actor/actor-easy-0/9f3c'
    >>> Alive.parse("alive/actor/actor-easy-0/9f3c")
    Alive(role='actor', process='actor-easy-0', incarnation='9f3c')
    """

    role: str
    process: str
    incarnation: str

    @property
    def key(self) -> str:
        return f"alive/{self.role}/{self.process}/{self.incarnation}"

    @classmethod
    def parse(cls, key: str) -> "Alive":
        """The token of a key.

        Raises:
            ValueError: the key is not that of a token.
        """
        parts = key.split("/")
        if len(parts) != 4 or parts[0] != "alive" or not all(parts):
            raise ValueError(f"{key!r} is not alive/ROLE/PROCESS/INCARNATION")
        return cls(*parts[1:])
