"""What the command line asks of `tools.levels.tasks`: one JSON file, checked on both ends."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from railctl.common.levels.distributions import MOST_HELD_OUT, AnyLevels, LevelName
from railctl.common.strict import Strict

MOST_PROCESSES = 1024
MOST_LEVELS = 500_000  # of a file

Distributions = dict[LevelName, AnyLevels]


class BuildRequest(Strict):
    """Training levels of some run seeds and evaluation levels shall be put into a bank.

    Attributes:
        bank: its folder.
        levels: distributions by name.
        first_seed: of the runs that shall find their levels.
        last_seed: likewise, included.
        episodes: training levels of each run.
        evaluation: evaluation levels; None: all that training never sees.
        processes: to build with.
    """

    task: Literal["build"] = "build"
    bank: Path
    levels: Distributions
    first_seed: int = Field(ge=0, lt=2**31)
    last_seed: int = Field(ge=0, lt=2**31)
    episodes: int = Field(ge=0)
    evaluation: int | None = Field(default=None, ge=0, le=MOST_HELD_OUT)
    processes: int = Field(ge=1, le=MOST_PROCESSES)


class PrepareRequest(Strict):
    """What distributions hold out shall be found out, before a run starts (see `common.levels.prepare`)."""

    task: Literal["prepare"] = "prepare"
    bank: Path
    levels: Distributions
    processes: int = Field(ge=1)


class VerifyRequest(Strict):
    """A bank shall be checked, and a sample of it generated again where the distribution is known."""

    task: Literal["verify"] = "verify"
    bank: Path
    levels: Distributions
    sample: int = Field(ge=0)


class ReplayRequest(Strict):
    """Recorded episodes shall be replayed."""

    task: Literal["replay"] = "replay"
    file: Path


class Drawn(Strict):
    """Levels of a distribution.

    Attributes:
        name: of the distribution.
        levels: the distribution.
        bank: where generated levels may lie ready.
        base: where the paths of level files start from.
    """

    name: LevelName
    levels: AnyLevels
    bank: Path
    base: Path


class ShowRequest(Strict):
    """A level shall be drawn: of a file, or of a distribution by the generator's seed or as evaluation level."""

    task: Literal["show"] = "show"
    file: Path | None = None
    group: str | None = None
    index: int = Field(default=0, ge=0)
    drawn: Drawn | None = None
    seed: int = Field(default=0, ge=0, lt=2**32)
    evaluation: int | None = Field(default=None, ge=0)
    output: Path


class ImportRequest(Strict):
    """Levels of several files shall be gathered in one .npz file."""

    task: Literal["import"] = "import"
    files: tuple[Path, ...] = Field(min_length=1)
    group: str | None = None
    output: Path


class ExportRequest(Strict):
    """Levels of a file or a distribution shall be written as an .npz file, or as flatland's own into a folder.

    Attributes:
        file: whose levels.
        drawn: or of which distribution.
        count: of a distribution, so many; None: 100, or all evaluation levels if there are fewer.
        seed: of the runs whose training levels these are; None: evaluation levels.
        output: an .npz file or a folder.
    """

    task: Literal["export"] = "export"
    file: Path | None = None
    drawn: Drawn | None = None
    count: int | None = Field(default=None, ge=1, le=MOST_LEVELS)
    seed: int | None = Field(default=None, ge=0, lt=2**31)
    output: Path


Request = BuildRequest | PrepareRequest | VerifyRequest | ReplayRequest | ShowRequest | ImportRequest | ExportRequest
REQUESTS: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="task")])
