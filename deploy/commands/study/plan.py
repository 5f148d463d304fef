"""railctl study plan: what a study is made of, and what it will take."""

import json
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from railctl.analysis.study import PlannedRun, Study, StudyFolder
from railctl.common.config import RunConfig
from railctl.common.levels.bank import bank_root
from railctl.deploy.commands.study.options import Cores, OtherName, StudyName
from railctl.deploy.output import AsJson, console, one_line_errors, print_table
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.show import duration
from railctl.deploy.study.calibration import measure
from railctl.deploy.study.described import configurations, find_study, named
from railctl.deploy.study.estimate import Cell, Rate, measured, run_seconds, seconds_left
from railctl.deploy.study.levels import missing_levels
from railctl.deploy.study.progress import Looking, StudyProgress
from railctl.deploy.study.work import alone, cores_of

GB = 1e9


@one_line_errors
def plan(name: StudyName, cores: Cores = None, other_name: OtherName = None, as_json: AsJson = False) -> None:
    """Say how many runs and levels a study needs, and the hours and the disk, measured on its runs or without."""
    used = cores_of(cores)
    study = named(find_study(name), other_name)
    configs = configurations(study, used)
    folder = StudyFolder(runs_root() / study.name)
    missing = missing_levels(study, configs, bank_root(runs_root()))
    with alone(folder):
        progress = Looking(folder, study).look()
        try:
            new = measure(folder, unknown_of(progress, folder, configs), used, Console(stderr=True, highlight=False))
        except KeyboardInterrupt:
            raise Failed(f"stopped: railctl study plan {name} measures again") from None
    document = planned(study, progress, measured(folder, progress), used)
    document |= {"levels_to_generate": missing, "measured_now": len(new)}
    if as_json:
        print(json.dumps(document, indent=2))
    else:
        _print(study, document, used)


def unknown_of(
    progress: StudyProgress, folder: StudyFolder, configs: Mapping[PlannedRun, RunConfig]
) -> dict[PlannedRun, RunConfig]:
    """The first run of each contender on each level of which none is over."""
    over = {cell for cell, rate in measured(folder, progress).items() if rate.source == "run"}
    firsts = [runs[0].run for cell, runs in progress.cells().items() if cell not in over]
    return {run: configs[run] for run in firsts}


def planned(study: Study, progress: StudyProgress, rates: dict[Cell, Rate], cores: int) -> dict[str, Any]:
    """What is left of a study and what that takes."""
    seconds = run_seconds(rates, study)
    return {
        "study": study.name,
        "cores": cores,
        "runs": len(progress.runs),
        "runs_done": progress.count("done"),
        "expected_s": seconds_left(progress, rates, cores),
        "disk_bytes": sum(rates[cell].run_bytes * len(runs) for cell, runs in progress.cells().items()),
        "cells": [
            {
                "contender": contender,
                "level": level,
                "measured_on": rate.source,
                "measured_episodes": rate.episodes,
                "episode_s": round(rate.episode_s, 5),
                "run_s": round(seconds[contender, level], 1),
                "run_bytes": rate.run_bytes,
            }
            for (contender, level), rate in rates.items()
        ],
    }


def _print(study: Study, document: dict[str, Any], cores: int) -> None:
    counts = f"{len(study.contenders)} contenders x {len(study.levels)} levels x {len(study.seeds)} seeds"
    lines = [
        f"{study.name}: {counts} = {document['runs']} runs of {study.episodes} episodes, {document['runs_done']} done",
        "levels to generate: " + ", ".join(f"{n} {level}" for level, n in document["levels_to_generate"].items()),
        f"expected: {duration(document['expected_s'])} on {cores} cores, {document['disk_bytes'] / GB:.1f} GB of disk",
    ]
    kept = sum(cell["measured_on"] == "calibration" for cell in document["cells"]) - document["measured_now"]
    lines.append(f"measured: {document['measured_now']} now, {kept} kept from before")
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
    table = Table("contender", "level", box=None, pad_edge=False)
    for column in ("ms/episode", "a run", "measured on"):
        table.add_column(column, justify="right")
    for cell in document["cells"]:
        source = "a run of it" if cell["measured_on"] == "run" else f"{cell['measured_episodes']} episodes"
        took = (f"{cell['episode_s'] * 1000:.0f}", duration(cell["run_s"]), source)
        table.add_row(cell["contender"], cell["level"], *took)
    print_table(table)
