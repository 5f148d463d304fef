"""Runs as if they had been trained."""

import json
from collections.abc import Callable

import pytest

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.common.folder import RunFolder
from railctl.deploy.launch import new_run
from railctl.deploy.study.described import configurations


@pytest.fixture
def made_run() -> Callable[..., RunFolder]:
    return make


def make(folder: StudyFolder, study: Study, run: PlannedRun, episodes: int, outcome: str | None = None) -> RunFolder:
    """A run that trained an episode every 2 s, and whose last network was scored on 50 levels in 5 s."""
    folder.runs.mkdir(parents=True, exist_ok=True)
    place = new_run(run.name, configurations(study, 1)[run], folder.runs)
    row = {
        "level": run.level,
        "seed": 1,
        "return": -0.5,
        "arrived": 1,
        "trains": 3,
        "steps": 9,
        "decisions": 5,
        "epsilon": 0.1,
        "weights_version": 1,
        "digest": "0" * 32,
        "actor": "actor-easy-0",
        "acting_s": 0.1,
    }
    lines = [json.dumps(row | {"episode": index, "trained_unix_s": 100 + 2.0 * index}) for index in range(episodes)]
    place.episodes_file.write_text("".join(f"{line}\n" for line in lines))
    scored = {
        "episode": episodes,
        "level": run.level,
        "mode": "greedy",
        "levels": 50,
        "return": -0.5,
        "mean_steps": 9.0,
        "arrived_share": 0.5,
        "all_arrived_share": 0.5,
        "weights_digest": "0" * 32,
        "evaluated_unix_s": 1.0,
    }
    place.evaluations_file.write_text(json.dumps(scored | {"evaluating_s": 5.0}) + "\n")
    if outcome:
        place.outcome_file.write_text(json.dumps({"outcome": outcome, "reason": "why" if outcome == "failed" else ""}))
    return place
