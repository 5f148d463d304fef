"""What machines that join a run ask, and are told."""

from typing import Annotated

from pydantic import Field

from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Count, Record, Text

PART_BYTES = 256_000  # a slow link has room for it before whoever sends loses patience
NAMESPACE_PATTERN = r"^railctl/[0-9a-f]{1,32}$"
Namespace = Annotated[str, Field(pattern=NAMESPACE_PATTERN)]


class RunIntroduction(Record):
    """The run of a cluster."""

    name: Text
    namespace: Namespace
    config: Annotated[str, Field(max_length=1_000_000)]  # resolved, as in its file


class LevelPartRequest(Record):
    """Asks for a part of the run's own copy of the level files of a distribution, from a byte on."""

    level: LevelName
    first: Count


class LevelPart(Record):
    """That part, and how many bytes the whole copy has."""

    content: Annotated[bytes, Field(max_length=PART_BYTES)]
    total: Count
