"""What machines that join a run ask, and are told."""

from typing import Annotated

from pydantic import Field

from railctl.common.levels.distributions import LevelName
from railctl.common.records.base import Record, Text

MOST_LEVEL_BYTES = 200_000_000
NAMESPACE_PATTERN = r"^railctl/[0-9a-f]{1,32}$"
Namespace = Annotated[str, Field(pattern=NAMESPACE_PATTERN)]


class RunIntroduction(Record):
    """The run of a cluster."""

    name: Text
    namespace: Namespace
    config: Annotated[str, Field(max_length=1_000_000)]  # resolved, as in its file


class LevelsRequest(Record):
    """Asks for the run's own copy of the level files of a distribution."""

    level: LevelName


class LevelFileCopy(Record):
    """That copy, whole."""

    content: Annotated[bytes, Field(max_length=MOST_LEVEL_BYTES)]
