"""What a study is: which algorithms learn on which levels with which seeds, and how they are judged.

A study lies in a folder:

    study.yaml                          the study as it was planned; it stays as it is
    calibration.json                    figures of short runs, which tell how long the study's will take
    runs/NAME-LEVEL-SEED/               runs, as `railctl up` makes them
    evaluations/NAME-LEVEL-SEED.json    the score of a run's last checkpoint, as `railctl evaluate --json` prints it
    references/POLICY-LEVEL.json        the score of a reference policy, likewise
    report/                             what is drawn and told of it
    results.json.xz                     results of runs that were made elsewhere, see `analysis.report.archive`
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from railctl.common.levels.distributions import LevelName
from railctl.common.mapping_file import read_mapping
from railctl.common.requests import Reference
from railctl.common.strict import ConfigError, Strict, describe

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,39}$")]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
MOST_SEEDS = 1000
MOST_DRAWS = 1_000_000


class Contender(Strict):
    """An algorithm as it takes part."""

    name: Name
    algorithm: str
    settings: dict[str, Any] = Field(default_factory=dict)  # keys of a run file

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        """`dqn` is {name: dqn, algorithm: dqn}; either name stands for a missing other one."""
        if isinstance(data, str):
            data = {"name": data}
        if isinstance(data, dict) and (known := data.get("name", data.get("algorithm"))) is not None:
            data = {"name": known, "algorithm": known} | data
        return data


class FinalEvaluation(Strict):
    """How every trained network is scored."""

    episodes: int = Field(default=1000, ge=1, le=1000)
    seed: Seed = 0


class Judgement(Strict):
    """How curves are judged: see `analysis.reliability`."""

    block: int = Field(default=100, ge=3)  # episodes an evaluation point
    zones: int = Field(default=3, ge=1)
    bootstraps: int = Field(default=1000, ge=1, le=MOST_DRAWS)
    permutations: int = Field(default=10_000, ge=1, le=MOST_DRAWS)


class Study(Strict):
    """A study: every contender learns on every level with every seed."""

    name: Name
    contenders: tuple[Contender, ...] = Field(min_length=1)
    levels: tuple[LevelName, ...] = Field(min_length=1)
    seeds: tuple[Seed, ...] = Field(min_length=1)
    episodes: int = Field(ge=1, le=10_000_000)
    settings: dict[str, Any] = Field(default_factory=dict)  # of all runs, keys of a run file
    evaluation: FinalEvaluation = FinalEvaluation()
    references: tuple[Reference, ...] = ()
    judgement: Judgement = Judgement()

    @field_validator("seeds", mode="before")
    @classmethod
    def _span(cls, seeds: Any) -> Any:
        """`1..10` is short for all from 1 to 10."""
        if isinstance(seeds, str):
            found = re.fullmatch(r"([0-9]{1,10})\.\.([0-9]{1,10})", seeds)
            if found is None or not int(found[1]) <= int(found[2]) < int(found[1]) + MOST_SEEDS:
                raise ValueError(f"{seeds!r} is no span of at most {MOST_SEEDS}: write for example 1..10, or a list")
            return list(range(int(found[1]), int(found[2]) + 1))
        return seeds

    @model_validator(mode="after")
    def _nothing_comes_twice(self) -> Self:
        names = [contender.name for contender in self.contenders]
        for field, values in (
            ("contenders", names),
            ("levels", self.levels),
            ("seeds", self.seeds),
            ("references", self.references),
        ):
            value, times = Counter(values).most_common(1)[0] if values else (None, 0)
            if times > 1:
                remedy = "give each a name of its own" if field == "contenders" else "leave the others out"
                raise ValueError(f"{field}: {value} is there {times} times: {remedy}")
        return self

    @model_validator(mode="after")
    def _nothing_shares_a_file(self) -> Self:
        """Names may have the hyphens in them that join them in those of files: `x` on `a-b` and `x-a` on `b`."""
        for field, firsts, remedy in (
            ("contenders", [contender.name for contender in self.contenders], "give one another name"),
            ("references", self.references, "give a level another name"),
        ):
            of_file: dict[str, str] = {}
            for first in firsts:
                for level in self.levels:
                    told = f"{first} on {level}"
                    if (other := of_file.setdefault(f"{first}-{level}", told)) != told:
                        raise ValueError(f"{field}: {other} and {told} would both be {first}-{level}: {remedy}")
        return self

    @model_validator(mode="after")
    def _zones_have_points(self) -> Self:
        block, zones = self.judgement.block, self.judgement.zones
        if self.episodes % block:
            raise ValueError(
                f"episodes {self.episodes} is not a multiple of judgement.block {block}: make one fit the other"
            )
        if self.episodes // block < zones:
            raise ValueError(
                f"episodes {self.episodes} are {self.episodes // block} blocks of judgement.block {block}, fewer than "
                f"judgement.zones {zones}: train longer, or make one of them smaller"
            )
        return self


class PlannedRun(NamedTuple):
    """One run of a study."""

    contender: str
    level: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.contender}-{self.level}-{self.seed}"


def planned_runs(study: Study) -> Iterator[PlannedRun]:
    """All runs of a study, seed by seed, so that what is done of it compares all contenders."""
    for seed in study.seeds:
        for level in study.levels:
            for contender in study.contenders:
                yield PlannedRun(contender.name, level, seed)


@dataclass(frozen=True)
class StudyFolder:
    """Where everything of a study lies."""

    path: Path

    @property
    def study_file(self) -> Path:
        return self.path / "study.yaml"

    @property
    def runs(self) -> Path:
        return self.path / "runs"

    @property
    def calibration(self) -> Path:
        return self.path / "calibration.json"

    @property
    def processes(self) -> Path:
        return self.path / "processes"

    @property
    def report(self) -> Path:
        return self.path / "report"

    @property
    def results(self) -> Path:
        return self.path / "results.json.xz"

    def run(self, run: PlannedRun) -> Path:
        return self.runs / run.name

    def evaluation(self, run: PlannedRun) -> Path:
        return self.path / "evaluations" / f"{run.name}.json"

    def reference(self, policy: str, level: str) -> Path:
        return self.path / "references" / f"{policy}-{level}.json"


def read_study(path: Path) -> Study:
    """The study of a YAML file; one that does not say its name is named after the file.

    Raises:
        ConfigError: one line that names the file, the field, its value and the remedy.
    """
    data = read_mapping(path, "give a file that describes a study", "contenders: [dqn, ppo]")
    try:
        return Study.model_validate({"name": path.stem} | data)
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe(error, Study)}") from None
