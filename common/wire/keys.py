"""Every key of a run, relative to the run's namespace. A channel ties its key to the records that travel on it.

Only `RUN` is outside: who asks it does not know the run yet.
"""

from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from railctl.common.records import acting, checkpoints, control, heartbeats, joining, rows
from railctl.common.records.base import Record

A = TypeVar("A", bound=Record)
B = TypeVar("B", bound=Record)

ROOT = "railctl"  # all namespaces begin with it


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


FRAGMENTS = Topic("fragments", acting.Fragment)
EPISODE_ROWS = Topic("rows/episodes", rows.EpisodeRow)
EVALUATION_ROWS = Topic("rows/evaluations", rows.EvaluationRow)
CHECKPOINTS = Topic("checkpoints", checkpoints.CheckpointNotice)
HEARTBEATS = Topic("heartbeats", heartbeats.Heartbeat)
FAR_HEARTBEATS = Topic("heartbeats/far", heartbeats.Heartbeat)  # of actors on other machines: only status believes them

LEASE = Service("lease", acting.LeaseRequest, acting.LeaseAnswer)
PULL_WEIGHTS = Service("pull/weights", acting.WeightsRequest, acting.Weights)
LIST_CHECKPOINTS = Service("list/checkpoints", control.Empty, checkpoints.CheckpointNotice)
PULL_CHECKPOINT = Service("pull/checkpoint", checkpoints.CheckpointRequest, checkpoints.CheckpointFile)
EPISODE_HISTORY = Service("history/episodes", rows.HistoryRequest, rows.EpisodeRows)
EVALUATION_HISTORY = Service("history/evaluations", rows.HistoryRequest, rows.EvaluationRows)
COMMAND_LEARNER = Service("command/learner", control.LearnerCommand, control.CommandAnswer)
STATUS = Service("command/status", control.Empty, control.Status)
SCALE = Service("command/scale", control.ScaleRequest, control.CommandAnswer)
STOP = Service("command/stop", control.Empty, control.CommandAnswer)
RUN = Service(f"{ROOT}/run", control.Empty, joining.RunIntroduction)
PULL_LEVELS = Service("pull/levels", joining.LevelPartRequest, joining.LevelPart)

ALL_ALIVE = "alive/*/*/*"


def absolute(namespace: str, key: str) -> str:
    """A key as it is on the wire.

    >>> absolute("railctl/9f3c", "lease"), absolute("railctl/9f3c", RUN.key)
    ('railctl/9f3c/lease', 'railctl/run')
    """
    return key if key.startswith(f"{ROOT}/") else f"{namespace}/{key}"


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
