"""How checkpoints are announced and pulled."""

from pydantic import Field

from railctl.common.records.base import Count, Record

MOST_LISTED = 100_000


class CheckpointNotice(Record):
    """The learner has written the checkpoints after these numbers of episodes; `finished`: no more will come."""

    episodes: list[Count] = Field(max_length=MOST_LISTED)
    finished: bool


class CheckpointRequest(Record):
    """Asks for the checkpoint after `episode` episodes."""

    episode: Count


class CheckpointFile(Record):
    """A checkpoint, byte for byte as on disk; its own digest protects it."""

    episode: Count
    content: bytes = Field(max_length=256_000_000)
