"""What is measured for a study's plan, kept in its folder for as long as description, machine and versions stay."""

import hashlib
import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from typing import Any

from pydantic import TypeAdapter
from rich.console import Console

from railctl.analysis.study import PlannedRun, StudyFolder
from railctl.common.bounded import read_json
from railctl.common.config import RunConfig
from railctl.common.folder import write_atomically
from railctl.common.levels.bank import bank_root
from railctl.common.machine import processor
from railctl.common.strict import ConfigError, Strict
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.task import Task

MEASURER = "railctl.tools.bench.rates"
PACKAGES = ("railctl", "numba", "torch")  # whose versions figures depend on
ROWS_BYTES = 1000  # of an episode, in all files
REST_BYTES = 80_000  # of a run: its picture, its logs
LOOK_S = 0.05


class Figures(Strict):
    """What one run of a contender on a level takes, measured in one process without messages.

    Attributes:
        made_of: what it depends on.
        episode_s: to act and to train an episode.
        episodes: that were counted.
        fragments: an episode.
        level_s: to score a network on a level.
        run_bytes: that it leaves behind.
    """

    made_of: str
    episode_s: float
    episodes: int
    fragments: float
    level_s: float
    run_bytes: int


KEPT = TypeAdapter(dict[str, Figures])


def kept(folder: StudyFolder) -> dict[str, Figures]:
    """What has been measured, by the name of the run that it was measured with."""
    try:
        return KEPT.validate_python(read_json(folder.calibration))
    except (OSError, ValueError):
        return {}  # it is measured anew


def measure(folder: StudyFolder, configs: Mapping[PlannedRun, RunConfig], cores: int, console: Console) -> set[str]:
    """Have figures of these runs, as many processes at once as there are cores; returns the names of those measured.

    Raises:
        Failed: a run cannot be measured, and what is wrong with it is wrong with the study's.
        KeyboardInterrupt: somebody asked to stop.
    """
    known = kept(folder)
    lacking = {
        run.name: (config, made_of)
        for run, config in configs.items()
        if (made_of := _made_of(config, cores)) != (known[run.name].made_of if run.name in known else None)
    }
    if lacking:
        console.print(f"measuring {len(lacking)} short runs, each in one process", markup=False)
    names = list(lacking)
    with ExitStack() as stack:
        shares = [names[core::cores] for core in range(min(cores, len(names)))]
        tasks = [stack.enter_context(_measuring({name: lacking[name][0] for name in share})) for share in shares]
        for found in _results(tasks):
            known |= {name: _figures(*lacking[name], figures) for name, figures in found.items()}
            write_atomically(folder.calibration, json.dumps(KEPT.dump_python(known), indent=2))
    return set(lacking)


def _figures(config: RunConfig, made_of: str, found: dict[str, Any]) -> Figures:
    checkpoints = -(-config.episodes // config.evaluation.every_episodes)
    networks = found.pop("checkpoint_bytes") * checkpoints
    return Figures(made_of=made_of, run_bytes=config.episodes * ROWS_BYTES + networks + REST_BYTES, **found)


def _made_of(config: RunConfig, cores: int) -> str:
    """A digest of what figures depend on."""
    parts = [config.science, processor(), cores, {name: version(name) for name in PACKAGES}]
    return hashlib.blake2b(json.dumps(parts, sort_keys=True).encode(), digest_size=16).hexdigest()


@contextmanager
def _measuring(configs: Mapping[str, RunConfig]) -> Iterator[Task]:
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        runs = {name: config.plain() for name, config in configs.items()}
        json.dump({"bank": str(bank_root(runs_root())), "runs": runs}, file)
        file.flush()
        task = Task(MEASURER, file.name)
        try:
            yield task
        finally:
            task.end()


def _results(tasks: Sequence[Task]) -> Iterator[dict[str, Any]]:
    """What they found, as they end."""
    waiting = list(tasks)
    while waiting:
        for task in [task for task in waiting if task.has_ended()]:
            waiting.remove(task)
            try:
                yield task.result()
            except (ConfigError, Failed) as error:
                raise Failed(f"a short run failed: {error}") from None
        time.sleep(LOOK_S)
