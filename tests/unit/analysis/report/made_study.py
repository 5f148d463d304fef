"""Folders of runs and studies as they lie on disk, with made-up curves."""

import json

import numpy as np
import yaml

from railctl.analysis.study import PlannedRun, Study, StudyFolder, planned_runs
from railctl.common.folder import RunFolder
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.deploy.launch import save_config
from railctl.deploy.resolve import resolve

DIGEST = "0" * 32
BEGUN = 1_700_000_000.0


def make_run(path, returns, *, scored=None, **given):
    """A run that has trained to these returns, an episode a second."""
    folder = RunFolder(path)
    path.mkdir(parents=True)
    config = resolve({"episodes": len(returns)} | given)
    save_config(folder, config)
    levels = list(config.mix)
    rows = [
        EpisodeRow(
            episode=number,
            level=levels[number % len(levels)],
            seed=number,
            normalised_return=float(value),
            arrived=1,
            trains=3,
            steps=100,
            decisions=10,
            epsilon=0.0,
            weights_version=number,
            digest=DIGEST,
            actor="actor-0",
            acting_s=1.0,
            trained_unix_s=BEGUN + number + 1,
            staleness=number % 4,
        )
        for number, value in enumerate(returns)
    ]
    folder.episodes_file.write_text("".join(row.model_dump_json(by_alias=True) + "\n" for row in rows))
    if scored is not None:
        row = EvaluationRow(
            episode=len(returns),
            level=levels[0],
            mode="greedy",
            levels=50,
            normalised_return=scored,
            arrived_share=0.75,
            all_arrived_share=0.5,
            mean_steps=100.0,
            weights_digest=DIGEST,
            evaluated_unix_s=BEGUN,
            evaluating_s=1.0,
        )
        folder.evaluations_file.write_text(row.model_dump_json(by_alias=True) + "\n")
    return path


def evaluation(level, returns):
    """A document as `railctl evaluate --json` prints it."""
    row = {
        "level": level,
        "levels": len(returns),
        "mean": float(np.mean(returns)),
        "low": None,
        "high": None,
        "std": None,
    }
    row |= {"median": float(np.median(returns)), "arrived_share": 0.75, "all_arrived_share": 0.5, "mean_steps": 100.0}
    return json.dumps(
        {
            "checkpoint": "c",
            "algorithm": "a",
            "episode": 1,
            "mode": "greedy",
            "rows": [row | {"returns": list(returns)}],
        }
    )


def write_study(path, **given):
    """The folder of a study that has not begun."""
    study = Study.model_validate(given)
    folder = StudyFolder(path)
    for of_study in (folder.runs, path / "evaluations", path / "references"):
        of_study.mkdir(parents=True)
    folder.study_file.write_text(yaml.safe_dump(study.model_dump(mode="json"), sort_keys=False))
    return folder, study


def curve(run: PlannedRun, episodes, quality):
    """Returns that rise from -0.9 towards -0.9 + `quality`, with noise of the run's own."""
    rng = np.random.default_rng([run.seed, len(run.contender), ord(run.contender[-1]), ord(run.level[0])])
    rise = quality * (1 - np.exp(-np.arange(episodes) / (0.3 * episodes)))
    drift = 0.05 * rng.normal() + np.cumsum(rng.normal(0, 0.004, episodes))
    return np.clip(-0.9 + rise + drift + rng.normal(0, 0.12, episodes), -1, -0.05)


def make_study(path, qualities, *, scored_levels=20, references=("random",), **given):
    """A whole study; `qualities` says by contender how much it learns."""
    names = [{"name": name, "algorithm": name.split("-")[0]} for name in qualities]
    folder, study = write_study(path, name="made", contenders=names, references=references, **given)
    for run in planned_runs(study):
        returns = curve(run, study.episodes, qualities[run.contender])
        make_run(folder.run(run), returns, algorithm=run.contender.split("-")[0], level=run.level, seed=run.seed)
        folder.evaluation(run).write_text(evaluation(run.level, [*returns[-scored_levels:]]))
    for policy in references:
        for level in study.levels:
            folder.reference(policy, level).write_text(evaluation(level, [-0.5, -0.75, -1.0]))
    return folder
