"""`python -m railctl.tools.levels.tasks REQUEST`: what the command line does with levels, where flatland may be imported.

The request is a file (see `common.levels.requests`); how the answers go: see `common.task`.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from railctl.common.bounded import read_json
from railctl.common.levels import files
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.build import Progress, build, build_training
from railctl.common.levels.chunks import BankError, key_of
from railctl.common.levels.distributions import LevelFiles
from railctl.common.levels.files import Groups, LevelFileError
from railctl.common.levels.held_out import AllHeldOutError
from railctl.common.levels.level import InfeasibleLevelError, Level
from railctl.common.levels.prepare import prepare
from railctl.common.levels.reading import ReadFile, read, shape_name
from railctl.common.levels.requests import (
    REQUESTS,
    BuildRequest,
    Drawn,
    ExportRequest,
    ImportRequest,
    PrepareRequest,
    ReplayRequest,
    ShowRequest,
    VerifyRequest,
)
from railctl.common.levels.supply import LevelSupply
from railctl.common.seeding import evaluation_level_seed, training_level_seed
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say
from railctl.tools.levels.verify import verify

MOST_EXPORTED = 100  # if no number is given


def build_bank(request: BuildRequest) -> None:
    """Build the training levels of some run seeds and the evaluation levels into a bank."""
    built, held = {}, {}
    for name, levels in request.levels.items():
        if isinstance(levels, LevelFiles):
            raise ConfigError(f"--level {name}: these levels come out of files, so there is nothing to build")
        tell = partial(_tell, name)
        prepare(request.bank, name, levels, request.processes, tell)
        training = [
            training_level_seed(run, episode)
            for run in range(request.first_seed, request.last_seed + 1)
            for episode in range(request.episodes)
        ]
        count = levels.held_out if request.evaluation is None else request.evaluation
        evaluation = [evaluation_level_seed(index) for index in range(count)]
        before = len(LevelBank(request.bank).seeds(key_of(levels)))
        build(request.bank, levels, evaluation, request.processes, tell)
        build_training(request.bank, levels, training, request.processes, tell)
        held[name] = len(LevelBank(request.bank).seeds(key_of(levels)))
        built[name] = held[name] - before
    say({"bank": str(request.bank), "built": built, "levels": held})


def _tell(name: str, progress: Progress) -> None:
    say({"progress": {"of": name, **vars(progress)}})


def prepare_levels(request: PrepareRequest) -> None:
    """Find out what distributions hold out."""
    for name, levels in request.levels.items():
        prepare(request.bank, name, levels, request.processes, partial(_tell, name))
    say({"prepared": list(request.levels)})


def verify_bank(request: VerifyRequest) -> None:
    """Check all levels of a bank."""
    known = {key_of(levels): levels for levels in request.levels.values() if not isinstance(levels, LevelFiles)}
    count = verify(request.bank, request.sample, known, Teller("levels").tell)
    say({"bank": str(request.bank), "levels": count})


def replay(request: ReplayRequest) -> None:
    """Replay recorded episodes, and count where they differ."""
    from railctl.tools.recordings.replay import replay_file  # noqa: PLC0415  (compiled code, which no other task needs)

    say({"file": str(request.file), **replay_file(request.file, Teller("episodes").tell).document()})


def show(request: ShowRequest) -> None:
    """Draw one level."""
    from railctl.tools.levels.draw import draw  # noqa: PLC0415  (matplotlib, which no other task needs)
    from railctl.tools.levels.routes import numbers  # noqa: PLC0415

    level, title, left_out = _chosen(request)
    facts = numbers(level)
    schedule = level.schedule
    say(
        {
            "picture": str(draw(level, request.output, title)),
            "title": title,
            "trains": level.n_trains,
            "max_steps": level.max_steps,
            "rail_cells": facts.rail_cells,
            "switches": facts.switches,
            "distances": facts.distances,
            "speeds": [1.0] * level.n_trains
            if schedule is None
            else (schedule.speeds[:, 0] / schedule.speeds[:, 1]).tolist(),
            "malfunctions": schedule and schedule.malfunctions and schedule.malfunctions._asdict(),
            "left_out": left_out,
            "content_hash": level.content_hash,
        }
    )


def _chosen(request: ShowRequest) -> tuple[Level, str, list[str]]:
    """The level that is asked for, its title, and what of its file is left out."""
    drawn = request.drawn
    if drawn is not None:
        supply, index = _supply(drawn), request.evaluation
        if index is not None:
            return supply.evaluation(drawn.name, index), f"{drawn.name}, evaluation {index}", []
        return supply.level(drawn.name, request.seed), f"{drawn.name}, seed {request.seed}", []
    assert request.file is not None  # noqa: S101  (it is one or the other)
    found = read(request.file)
    groups = found.groups
    name = request.group or next(iter(groups))
    if name not in groups:
        raise LevelFileError(f"{request.file} has no group {name}: it has {', '.join(groups)}")
    if not 0 <= request.index < len(groups[name]):
        raise LevelFileError(
            f"{request.file}: no level of index {request.index} in {name}, the last is {len(groups[name]) - 1}"
        )
    title = f"{request.file.name}: {name} {request.index}"
    return groups[name][request.index], title, found.left_out


def _supply(drawn: Drawn) -> LevelSupply:
    return LevelSupply({drawn.name: drawn.levels}, drawn.bank, base=drawn.base)


def import_files(request: ImportRequest) -> None:
    """Gather the levels of several files in one .npz file."""
    gathered: Groups = {}
    held = []
    for path in request.files:
        found = read(path)
        held.append({"file": str(path), "groups": _counts(found.groups), "left_out": found.left_out})
        for name, levels in found.groups.items():
            gathered.setdefault(request.group or name, []).extend(levels)
    groups: Groups = {}
    for name, levels in gathered.items():
        for part, some in _by_shape(name, levels).items():
            groups.setdefault(part, []).extend(some)
    files.save(request.output, groups)
    left_out = [f"{file['file']}: {note}" for file in held for note in file["left_out"]]
    say({"file": str(request.output), "groups": _counts(groups), "files": held, "left_out": left_out})


def export(request: ExportRequest) -> None:
    """Write levels of a distribution or a file as one .npz file, or as .pkl files for flatland's tools."""
    if request.drawn is not None:
        found = ReadFile(_by_shape(request.drawn.name, list(_drawn(request, request.drawn))), [])
    else:
        assert request.file is not None  # noqa: S101  (it is one or the other)
        found = read(request.file)
    groups = found.groups
    if request.output.suffix == ".npz":
        files.save(request.output, groups)
        written = 1
    else:
        written = _write_pickles(request.output, groups)
    say({"output": str(request.output), "files": written, "groups": _counts(groups), "left_out": found.left_out})


def _write_pickles(folder: Path, groups: Groups) -> int:
    from railctl.tools.levels.export import save_pickle  # noqa: PLC0415  (flatland's files are not for every task)

    folder.mkdir(parents=True, exist_ok=True)
    for name, levels in groups.items():
        for index, level in enumerate(levels):
            save_pickle(folder / f"{name}_{index:04d}.pkl", level)
    return sum(map(len, groups.values()))


def _drawn(request: ExportRequest, drawn: Drawn) -> Iterator[Level]:
    supply = _supply(drawn)
    if request.seed is None:
        there = drawn.levels.evaluation_levels
        for index in range(request.count or min(MOST_EXPORTED, there)):
            yield supply.evaluation(drawn.name, index)
    else:
        for episode in range(request.count or MOST_EXPORTED):
            yield supply.training(drawn.name, training_level_seed(request.seed, episode))


def _by_shape(name: str, levels: Sequence[Level]) -> Groups:
    """A group of this name, or one a shape if there are several."""
    shapes: Groups = {}
    for level in levels:
        shapes.setdefault(shape_name(level), []).append(level)
    return {name: list(levels)} if len(shapes) == 1 else {f"{name}_{shape}": some for shape, some in shapes.items()}


def _counts(groups: Groups) -> dict[str, int]:
    return {name: len(levels) for name, levels in groups.items()}


TASKS: dict[type, Callable[[Any], None]] = {
    BuildRequest: build_bank,
    PrepareRequest: prepare_levels,
    VerifyRequest: verify_bank,
    ReplayRequest: replay,
    ShowRequest: show,
    ImportRequest: import_files,
    ExportRequest: export,
}


def work() -> None:
    """Do what the request says.

    Raises:
        ConfigError: it is none.
        OSError: it cannot be read.
    """
    path = Path(*sys.argv[1:2])
    try:
        request = REQUESTS.validate_python(read_json(path))
    except ValueError:
        raise ConfigError(f"{path}: no request: these files are for the command line") from None
    TASKS[type(request)](request)


def main() -> None:
    carry_out(work, BankError, LevelFileError, InfeasibleLevelError, AllHeldOutError)


if __name__ == "__main__":
    main()
