"""A study's results in one small file, from which its report can be made anew without its runs.

JSON, compressed by xz: the study, every run with its resolved configuration, what its learner computed with, when it
was trained, its curve and its final score, and the scores of the reference policies.
"""

import lzma
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError

from railctl.analysis.report.results import Results, Scored, State, Trained
from railctl.analysis.study import PlannedRun, Study
from railctl.common.bounded import parse_json, read_bounded
from railctl.common.config import parse_config
from railctl.common.folder import write_atomically
from railctl.common.strict import ConfigError, Strict, describe

MOST_PACKED_BYTES, MOST_BYTES = 64_000_000, 1_000_000_000


class Archived(NamedTuple):
    """What a file holds.

    Attributes:
        study: whose results these are.
        runs: those that there are.
        references: scores, by policy and level.
    """

    study: Study
    runs: dict[PlannedRun, Trained]
    references: dict[tuple[str, str], Scored]

    @property
    def done(self) -> frozenset[PlannedRun]:
        """Runs of which nothing is left to do."""
        return frozenset(run for run, trained in self.runs.items() if trained.state == "done" and trained.scored)


class _Run(Strict):
    """A run, and the level that it was trained on."""

    run: PlannedRun
    state: State
    reason: str
    config: dict[str, Any] | None
    returns: tuple[float, ...]
    unix_s: tuple[float, float] | None
    arithmetic: dict[str, str]
    scored: Scored | None
    staleness: float | None = None


class _Reference(Strict):
    policy: str
    level: str
    scored: Scored


class _Archive(Strict):
    format: Literal["railctl results"] = "railctl results"
    version: Literal[1] = 1
    study: Study
    runs: tuple[_Run, ...] = Field(min_length=1)
    references: tuple[_Reference, ...]


def save(path: Path, results: Results) -> None:
    """Write the results of a study.

    Raises:
        ConfigError: they are of runs that belong to no study.
    """
    if results.study is None:
        raise ConfigError(f"{results.title}: only results of a study are kept in a file")
    archive = _Archive(
        study=results.study,
        runs=tuple(_packed(run, trained) for run, trained in results.runs.items() if trained.state != "missing"),
        references=tuple(
            _Reference(policy=policy, level=level, scored=scored)
            for (policy, level), scored in results.references.items()
            if scored is not None
        ),
    )
    write_atomically(path, lzma.compress(archive.model_dump_json().encode(), preset=9))


def load(path: Path) -> Archived:
    """What `save` wrote.

    Raises:
        ConfigError: the file cannot be read, or holds something else.
    """
    try:
        archive = _Archive.model_validate(parse_json(_unpacked_bytes(read_bounded(path, MOST_PACKED_BYTES))))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}: give a file that railctl study publish wrote") from None
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe(error, _Archive)}") from None
    except (lzma.LZMAError, EOFError, ValueError):
        raise ConfigError(f"{path}: damaged, or no results: give a file that railctl study publish wrote") from None
    return Archived(
        archive.study,
        {packed.run: _unpacked(packed) for packed in archive.runs},
        {(reference.policy, reference.level): reference.scored for reference in archive.references},
    )


def _unpacked_bytes(packed: bytes) -> bytes:
    """What was packed, in memory of the order of what it may be: a small file may announce any size.

    Raises:
        LZMAError: this was not packed.
        ValueError: it is larger, or not whole.
    """
    unpacking = lzma.LZMADecompressor(memlimit=MOST_BYTES)
    content = unpacking.decompress(packed, max_length=MOST_BYTES)
    if not unpacking.eof:
        raise ValueError("too large, or not whole")
    return content


def _packed(run: PlannedRun, trained: Trained) -> _Run:
    return _Run(
        run=run,
        state=trained.state,
        reason=trained.reason,
        config=None if trained.config is None else trained.config.plain(),
        returns=tuple(trained.returns.tolist()),
        unix_s=trained.unix_s,
        arithmetic=dict(trained.arithmetic),
        scored=trained.scored,
        staleness=trained.staleness,
    )


def _unpacked(packed: _Run) -> Trained:
    return Trained(
        state=packed.state,
        reason=packed.reason,
        config=None if packed.config is None else parse_config(packed.config),
        returns=np.array(packed.returns),
        unix_s=packed.unix_s,
        arithmetic=tuple(sorted(packed.arithmetic.items())),
        scored=packed.scored,
        staleness=packed.staleness,
    )
