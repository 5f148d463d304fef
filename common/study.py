"""What a study is: which algorithms learn on which levels with which seeds, and how they are judged.

A study lies in a folder:

    study.yaml                          the study as it was planned; it stays as it is
    runs/NAME-LEVEL-SEED/               runs, as `railctl up` makes them
    evaluations/NAME-LEVEL-SEED.json    the score of a run's last checkpoint, as `railctl evaluate --json` prints it
    references/POLICY-LEVEL.json        the score of a reference policy, likewise
    report/                             what is drawn and told of it
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from common.config import Difficulty, Strict

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,39}$")]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Reference = Literal["random", "shortest-path", "deadlock-avoidance", "deadlock-avoidance-entering", "planner", "alone"]
DRAWING: tuple[Reference, ...] = ("random", "planner")  # references that draw


class Contender(Strict):
    """An algorithm as it takes part."""

    name: Name
    algorithm: str
    settings: dict[str, Any] = Field(default_factory=dict)  # keys of a run file


class FinalEvaluation(Strict):
    """How every trained network is scored."""

    episodes: int = Field(default=1000, ge=1, le=1000)
    seed: Seed = 0


class Judgement(Strict):
    """How curves are judged: see `services.evaluator.reliability`."""

    block: int = Field(default=100, ge=3)  # episodes an evaluation point
    zones: int = Field(default=3, ge=1)
    bootstraps: int = Field(default=1000, ge=1)
    permutations: int = Field(default=10_000, ge=1)


class Study(Strict):
    """A study: every contender learns on every level with every seed."""

    name: Name
    contenders: tuple[Contender, ...] = Field(min_length=1)
    levels: tuple[Difficulty, ...] = Field(min_length=1)
    seeds: tuple[Seed, ...] = Field(min_length=1)
    episodes: int = Field(ge=1, le=10_000_000)
    settings: dict[str, Any] = Field(default_factory=dict)  # of all runs, keys of a run file
    evaluation: FinalEvaluation = FinalEvaluation()
    references: tuple[Reference, ...] = ()
    judgement: Judgement = Judgement()


class PlannedRun(NamedTuple):
    """One run of a study."""

    contender: str
    level: Difficulty
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
    def report(self) -> Path:
        return self.path / "report"

    def run(self, run: PlannedRun) -> Path:
        return self.runs / run.name

    def evaluation(self, run: PlannedRun) -> Path:
        return self.path / "evaluations" / f"{run.name}.json"

    def reference(self, policy: str, level: str) -> Path:
        return self.path / "references" / f"{policy}-{level}.json"
