"""Shares of a study's work: several commands, on as many machines, do all of it between them. Pure."""

import re
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

from railctl.analysis.study import PlannedRun, Study, planned_runs
from railctl.common.strict import ConfigError, shortened
from railctl.deploy.study.dispatcher import Comparing, Job, Scoring

FORM = re.compile(r"([0-9]{1,4})/([0-9]{1,4})", re.ASCII)

T = TypeVar("T")


class Share(NamedTuple):
    """The share of this number, from 1, out of so many."""

    number: int
    out_of: int

    def runs(self, study: Study) -> list[PlannedRun]:
        """Its runs: those of a contender on a level are dealt out, so that no share has all the long ones."""
        return self._dealt(sorted(planned_runs(study)))

    def jobs(self, study: Study, jobs: Sequence[Job]) -> list[Job]:
        """Its jobs out of all those of a study, in their order; the report is nobody's, for it needs everybody's."""
        runs = set(self.runs(study))
        references = self._dealt([Comparing(policy, level) for policy in study.references for level in study.levels])
        mine: set[Job] = {*runs, *map(Scoring, runs), *references}
        return [job for job in jobs if job in mine]

    def _dealt(self, things: Sequence[T]) -> list[T]:
        return list(things[self.number - 1 :: self.out_of])

    def __str__(self) -> str:
        return f"{self.number}/{self.out_of}"


def parse_share(text: str, study: Study) -> Share:
    """A share as it is written, `2/8`.

    Raises:
        ConfigError: it is none, or there are more shares than runs.
    """
    found = FORM.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ConfigError(f"--share {shortened(text)}: write I/N, with I from 1 to N, as 2/8")
    check_shares(f"--share {text}", int(found[2]), study)
    return Share(int(found[1]), int(found[2]))


def check_shares(field: str, shares: int, study: Study) -> None:
    """Raises ConfigError if some of so many shares would be empty."""
    runs = sum(1 for _ in planned_runs(study))
    if not 1 <= shares <= runs:
        raise ConfigError(f"{field}: study {study.name} has {runs} runs, make it 1 to {runs} shares")
