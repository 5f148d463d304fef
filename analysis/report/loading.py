"""Reading results from disk: those of a study's folder, or of any runs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from railctl.analysis.report import archive
from railctl.analysis.report.archive import Archived
from railctl.analysis.report.results import Results, Scored, State, Trained
from railctl.analysis.study import Judgement, PlannedRun, Study, StudyFolder, planned_runs, read_study
from railctl.common import checkpoint
from railctl.common.bounded import parse_json, read_json
from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder, numbered
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.common.requests import Reference
from railctl.common.rows import DamagedRows, read_rows
from railctl.common.strict import ConfigError, flat

POINTS = 15  # evaluation points of a curve, as in the study
BLOCK = 100  # episodes of one, if there are enough of them
LEAST_BLOCK = 3

Share = Annotated[float, Field(ge=0, le=1)]


class _Row(BaseModel):
    """What is needed of a row that `railctl evaluate --json` prints."""

    model_config = ConfigDict(allow_inf_nan=False)

    level: str
    levels: int
    mean: float
    arrived_share: Share
    all_arrived_share: Share
    returns: tuple[float, ...]


class _Evaluation(BaseModel):
    rows: tuple[_Row, ...]


class DamagedEvaluation(Exception):  # noqa: N818  (named for what is found)
    """A file of a study holds something that `railctl evaluate` did not write; the text names it."""


def load_study(folder: StudyFolder) -> Results:
    """All that a study has so far.

    Raises:
        ConfigError: its study cannot be read.
        DamagedEvaluation: a final evaluation cannot be read.
    """
    study = read_study(folder.study_file)
    elsewhere = archive.load(folder.results) if folder.results.exists() else Archived(study, {}, {})
    found = {run: elsewhere.runs[run] for run in elsewhere.done}
    runs = {run: found.get(run) or _of_study(folder, run, study) for run in planned_runs(study)}
    references = {
        (policy, level): elsewhere.references.get((policy, level)) or _scored(folder.reference(policy, level), level)
        for level in study.levels
        for policy in study.references
    }
    return _results_of(study, runs, references)


def load_results(path: Path) -> Results:
    """All that a file of `archive` holds.

    Raises:
        ConfigError: it cannot be read.
    """
    study, runs, references = archive.load(path)
    return _results_of(
        study,
        {run: runs.get(run, Trained()) for run in planned_runs(study)},
        {(policy, level): references.get((policy, level)) for level in study.levels for policy in study.references},
    )


def _results_of(
    study: Study, runs: dict[PlannedRun, Trained], references: Mapping[tuple[Reference, str], Scored | None]
) -> Results:
    return Results(
        title=study.name,
        contenders=tuple(contender.name for contender in study.contenders),
        levels=study.levels,
        seeds=study.seeds,
        episodes=study.episodes // study.judgement.block * study.judgement.block,
        judgement=study.judgement,
        runs=runs,
        scored_by=f"the last network of every run, on levels of evaluation seed {study.evaluation.seed}",
        references={(str(policy), level): scored for (policy, level), scored in references.items()},
        study=study,
    )


def _of_study(folder: StudyFolder, run: PlannedRun, study: Study) -> Trained:
    """A run of a study; one that cannot be read is one that failed."""
    path = folder.run(run)
    if not path.exists():
        return Trained()
    try:
        _config, bare, found = _read_run(path, study.episodes)
    except (ConfigError, DamagedRows) as error:
        return Trained(state="failed", reason=str(error))
    trained = found.get(run.level, bare)
    return replace(trained, scored=_scored(folder.evaluation(run), run.level))


def _scored(path: Path, level: str) -> Scored | None:
    """The score on a level in a document that `railctl evaluate --json` printed, or none if there is no document."""
    if not path.exists():
        return None
    try:
        rows = _Evaluation.model_validate(read_json(path)).rows
        row = next(row for row in rows if row.level == level)
    except (OSError, ValueError, StopIteration):
        raise DamagedEvaluation(f"{path} holds no score on {level}: delete it and run the study again") from None
    return Scored(row.levels, row.mean, row.arrived_share, row.all_arrived_share, row.returns)


def load_runs(paths: Sequence[Path]) -> Results:
    """Any runs, grouped by what they have in common; curves are compared as far as the shortest goes.

    Raises:
        ConfigError: there is no such run, one has no episodes, or two are the same.
        DamagedRows: a run's rows cannot be read.
    """
    configs: dict[Path, RunConfig] = {}
    found: dict[Path, dict[str, Trained]] = {}
    for path in paths:
        configs[path], _bare, found[path] = _read_run(path, None)
        if not found[path]:
            raise ConfigError(f"run {path} has no trained episodes yet: leave it out")
    names, labels = contenders(configs), level_labels(configs)
    runs: dict[PlannedRun, Trained] = {}
    whose: dict[PlannedRun, Path] = {}
    for path, levels in found.items():
        for level, trained in levels.items():
            run = PlannedRun(names[path], labels[path, level], configs[path].seed)
            if run in runs:
                raise ConfigError(
                    f"runs {whose[run]} and {path} are both {run.contender} on {level} with seed {run.seed}: "
                    "leave one of them out"
                )
            runs[run], whose[run] = trained, path
    trains = {label: configs[path].world.levels[level].bounds.trains for (path, level), label in labels.items()}
    return _of_runs(list(found), runs, sorted(trains, key=lambda name: (trains[name], name)))


def _of_runs(paths: Sequence[Path], runs: dict[PlannedRun, Trained], levels: Sequence[str]) -> Results:
    shortest = min(len(trained.returns) for trained in runs.values())
    block = BLOCK if shortest >= LEAST_BLOCK * BLOCK else max(LEAST_BLOCK, shortest // POINTS)
    points = shortest // block
    return Results(
        title=", ".join(path.name for path in paths) if len(paths) <= 3 else f"{len(paths)} runs",
        contenders=tuple(dict.fromkeys(run.contender for run in runs)),
        levels=tuple(level for level in levels if any(run.level == level for run in runs)),
        seeds=tuple(sorted({run.seed for run in runs})),
        episodes=points * block,
        judgement=Judgement(block=block, zones=max(1, min(3, points))),
        runs={run: runs[run] for run in sorted(runs, key=lambda run: run.seed)},
        scored_by="each run's own last evaluation while it trained, which has no returns of single levels",
    )


def contenders(configs: dict[Path, RunConfig]) -> dict[Path, str]:
    """A name for each run: its algorithm, and the settings in which runs of it on one level differ."""
    flattened = {path: flat(config.science | {"levels": {}}) for path, config in configs.items()}
    names = {}
    for path, config in configs.items():
        alike = [other for other in configs if configs[other].algorithm == config.algorithm]
        differing: dict[str, None] = {}
        for level in config.mix:
            peers = [flattened[other] for other in alike if level in configs[other].mix]
            differing |= dict.fromkeys(key for key in _differing(peers) if key != "seed")
        settings = [f"{key}={_spoken(flattened[path].get(key))}" for key in differing]
        names[path] = " ".join([config.algorithm, *settings])
    return names


def level_labels(configs: Mapping[Path, RunConfig]) -> dict[tuple[Path, str], str]:
    """A name for the levels of each run: that of the run file, and the settings in which levels of one name differ."""
    plain = {
        (path, name): flat(levels.model_dump(mode="json", exclude={"found"})) | {"digest": levels.identity}
        for path, config in configs.items()
        for name, levels in config.world.levels.items()
    }
    labels = {}
    for (path, name), ours in plain.items():
        differing = _differing([peer for (_, other), peer in plain.items() if other == name])
        told = [key for key in differing if key != "digest"] or differing  # of files alike, what is in them
        settings = [f"{key}={_spoken(ours.get(key))}" for key in told] if "digest" in differing else []
        labels[path, name] = " ".join([name, *settings])
    return labels


def _differing(peers: Sequence[Mapping[str, Any]]) -> list[str]:
    """The keys whose values are not the same everywhere."""
    keys = dict.fromkeys(key for peer in peers for key in peer)
    return [key for key in keys if len({repr(peer.get(key)) for peer in peers}) > 1]


def _spoken(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _read_run(path: Path, episodes: int | None) -> tuple[RunConfig, Trained, dict[str, Trained]]:
    """A run's configuration, how it stands, and what it has trained on each level so far.

    Raises:
        ConfigError: as `RunFolder.config`.
        DamagedRows: as `read_rows`.
    """
    folder = RunFolder(path)
    config = folder.config()
    rows = read_rows(folder.episodes_file, EpisodeRow)
    evaluations = read_rows(folder.evaluations_file, EvaluationRow)
    state, reason = _state(folder, done=len(rows) >= (episodes or config.episodes))
    bare = Trained(state=state, reason=reason, config=config, arithmetic=_arithmetic(folder))
    trained = {
        level: replace(
            bare,
            returns=np.array([row.normalised_return for row in ours]),
            unix_s=(rows[0].trained_unix_s - rows[0].acting_s, rows[-1].trained_unix_s),
            scored=_last([row for row in evaluations if row.level == level]),
            staleness=float(np.mean([row.staleness or 0 for row in ours])) if config.is_free else None,
        )
        for level in config.mix
        if (ours := [row for row in rows if row.level == level])
    }
    return config, bare, trained


def _state(folder: RunFolder, *, done: bool) -> tuple[State, str]:
    if done:
        return "done", ""
    outcome = folder.outcome()
    return ("failed", outcome.reason) if outcome is not None and outcome.outcome == "failed" else ("unfinished", "")


def _last(rows: Sequence[EvaluationRow]) -> Scored | None:
    if not rows:
        return None
    row = max(rows, key=lambda row: row.episode)
    return Scored(row.levels, row.normalised_return, row.arrived_share, row.all_arrived_share)


def _arithmetic(folder: RunFolder) -> tuple[tuple[str, str], ...]:
    """What the learner computed its newest checkpoint with, as far as that can be read."""
    paths = numbered(folder.checkpoints)
    try:
        _tensors, metadata = checkpoint.load(paths[-1], "checkpoint")
        found = parse_json(metadata["arithmetic"])
        return tuple((str(key), str(value)) for key, value in sorted(found.items()))
    except (IndexError, CheckpointError, KeyError, ValueError, AttributeError):
        return ()
