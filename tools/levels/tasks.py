"""`python -m tools.levels.tasks TASK`: what the command line does with levels, in a process that may import flatland.

How it answers: see `common.task`.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from common.levels import files, pickles
from common.levels.bank import LevelBank
from common.levels.build import Progress, build, build_training
from common.levels.chunks import BankError
from common.levels.distributions import shipped
from common.levels.files import Groups, LevelFileError
from common.levels.legacy import InfeasibleLevelError
from common.levels.level import Level
from common.levels.supply import LevelSupply
from common.seeding import evaluation_level_seed, training_level_seed
from common.task import Teller, carry_out, say
from tools.levels.verify import verify


def build_bank(options: argparse.Namespace) -> None:
    """Build the training levels of some run seeds and the evaluation levels into a bank."""
    built = {}
    for difficulty in options.level:

        def tell(progress: Progress, difficulty: str = difficulty) -> None:
            say({"progress": {"of": difficulty, **vars(progress)}})

        training = [
            training_level_seed(run, episode)
            for run in range(options.first_seed, options.last_seed + 1)
            for episode in range(options.episodes)
        ]
        evaluation = [evaluation_level_seed(index) for index in range(options.evaluation)]
        built[difficulty] = build(options.bank, difficulty, evaluation, options.processes, tell)
        built[difficulty] += build_training(options.bank, difficulty, training, options.processes, tell)
    bank = LevelBank(options.bank)
    say(
        {"bank": str(options.bank), "built": built, "levels": {name: len(bank.seeds(name)) for name in list(shipped())}}
    )


def verify_bank(options: argparse.Namespace) -> None:
    """Check all levels of a bank."""
    say({"bank": str(options.bank), "levels": verify(options.bank, options.sample, Teller("levels").tell)})


def replay(options: argparse.Namespace) -> None:
    """Replay recorded episodes, and count where they differ."""
    from tools.recordings.replay import replay_file  # noqa: PLC0415  (compiled code, which no other task needs)

    say({"file": str(options.file), **replay_file(options.file, Teller("episodes").tell).document()})


def show(options: argparse.Namespace) -> None:
    """Draw one level."""
    from tools.levels.draw import draw  # noqa: PLC0415  (matplotlib, which no other task needs)
    from tools.levels.routes import numbers  # noqa: PLC0415

    level, title = _chosen(options)
    facts = numbers(level)
    say(
        {
            "picture": str(draw(level, options.output, title)),
            "title": title,
            "trains": level.n_trains,
            "max_steps": level.max_steps,
            "rail_cells": facts.rail_cells,
            "switches": facts.switches,
            "distances": facts.distances,
            "content_hash": level.content_hash,
        }
    )


def _chosen(options: argparse.Namespace) -> tuple[Level, str]:
    if options.file is None:
        supply = LevelSupply(None, options.bank)
        if options.evaluation is not None:
            return supply.evaluation(
                options.level, options.evaluation
            ), f"{options.level}, evaluation {options.evaluation}"
        return supply.level(options.level, options.seed), f"{options.level}, seed {options.seed}"
    groups = read(options.file)
    name = options.group or next(iter(groups))
    if name not in groups:
        raise LevelFileError(f"{options.file} has no group {name}: it has {', '.join(groups)}")
    if not 0 <= options.index < len(groups[name]):
        raise LevelFileError(
            f"{options.file}: no level of index {options.index} in {name}, the last is {len(groups[name]) - 1}"
        )
    return groups[name][options.index], f"{options.file.name}: {name} {options.index}"


def read(path: Path) -> Groups:
    """The levels of a .npz or .pkl file; one without a name is named after its shape."""
    if path.suffix != ".pkl":
        return files.load(path)
    level = pickles.load_pickle(path)
    height, width = level.grid.shape
    return {f"{height}x{width}_{level.n_trains}_trains": [level]}


def import_files(options: argparse.Namespace) -> None:
    """Gather the levels of several files in one .npz file."""
    groups: Groups = {}
    for path in options.files:
        for name, levels in read(path).items():
            groups.setdefault(options.group or name, []).extend(levels)
    files.save(options.output, groups)
    say({"file": str(options.output), "groups": {name: len(levels) for name, levels in groups.items()}})


def export(options: argparse.Namespace) -> None:
    """Write levels of the bank, the generator or a file as one .npz file, or as .pkl files for flatland's tools."""
    groups = read(options.file) if options.file else {options.level: list(_drawn(options))}
    if options.output.suffix == ".npz":
        files.save(options.output, groups)
        written = 1
    else:
        from tools.levels.export import save_pickle  # noqa: PLC0415  (flatland's files are not for every task)

        options.output.mkdir(parents=True, exist_ok=True)
        written = 0
        for name, levels in groups.items():
            for index, level in enumerate(levels):
                save_pickle(options.output / f"{name}_{index:04d}.pkl", level)
                written += 1
    counts = {name: len(levels) for name, levels in groups.items()}
    say({"output": str(options.output), "files": written, "groups": counts})


def _drawn(options: argparse.Namespace) -> Iterator[Level]:
    supply = LevelSupply(None, options.bank)
    for index in range(options.count):
        if options.seed is None:
            yield supply.evaluation(options.level, index)
        else:
            yield supply.training(options.level, training_level_seed(options.seed, index))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Works on levels.")
    tasks = parser.add_subparsers(required=True)
    task = tasks.add_parser("build")
    task.set_defaults(run=build_bank)
    task.add_argument("--bank", type=Path, required=True)
    task.add_argument("--level", choices=list(shipped()), nargs="+", required=True)
    for option in ("--first-seed", "--last-seed", "--episodes", "--evaluation", "--processes"):
        task.add_argument(option, type=int, required=True)
    task = tasks.add_parser("verify")
    task.set_defaults(run=verify_bank)
    task.add_argument("--bank", type=Path, required=True)
    task.add_argument("--sample", type=int, default=100)
    task = tasks.add_parser("replay")
    task.set_defaults(run=replay)
    task.add_argument("file", type=Path)
    task = tasks.add_parser("show")
    task.set_defaults(run=show)
    task.add_argument("--file", type=Path)
    task.add_argument("--group")
    task.add_argument("--index", type=int, default=0)
    task.add_argument("--bank", type=Path)
    task.add_argument("--level", choices=list(shipped()), default="easy")
    task.add_argument("--seed", type=int, default=0)
    task.add_argument("--evaluation", type=int)
    task.add_argument("--output", type=Path, required=True)
    task = tasks.add_parser("import")
    task.set_defaults(run=import_files)
    task.add_argument("files", type=Path, nargs="+")
    task.add_argument("--group")
    task.add_argument("--output", type=Path, required=True)
    task = tasks.add_parser("export")
    task.set_defaults(run=export)
    task.add_argument("--file", type=Path)
    task.add_argument("--bank", type=Path)
    task.add_argument("--level", choices=list(shipped()), default="easy")
    task.add_argument("--count", type=int, default=100)
    task.add_argument("--seed", type=int)
    task.add_argument("--output", type=Path, required=True)
    return parser


def main() -> None:
    """Do what the arguments say."""
    options = _parser().parse_args()
    carry_out(lambda: options.run(options), BankError, LevelFileError, InfeasibleLevelError)


if __name__ == "__main__":
    main()
