"""Filling a level bank, with any number of processes and builders at once; `python -m railctl.common.levels.build` is a worker.

A request (a distribution and seeds) is cut into chunks in the same way by everybody. A worker goes through them, skips
those whose files are there, claims one by a lock that the kernel frees when its holder dies, generates its levels and
puts the file in place. So workers need not know of each other, a kill at any point loses no more than the chunks in
hand, and building the same again only adds what is missing.
"""

import argparse
import fcntl
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from railctl.common.interpreter import run_worker
from railctl.common.levels.bank import LevelBank
from railctl.common.levels.chunks import BankError, chunk_name, key_of, write_chunk
from railctl.common.levels.distributions import Generated, LegacyLevels, StockLevels
from railctl.common.levels.generate import generate
from railctl.common.levels.held_out import TRIES, HeldOut, retry_seed
from railctl.common.levels.level import InfeasibleLevelError
from railctl.common.strict import Strict

CHUNK_LEVELS = 128  # at most
CHUNK_WORK = CHUNK_LEVELS * 25 * 25 * 7  # cells times trains of a chunk: a kill shall never lose more than a minute
INFEASIBLE = "infeasible: "  # begins the last line of a worker whose seed has no level
WAIT_S = 0.1  # for chunks that another builder has in hand


class Request(Strict):
    """What a worker is asked for."""

    root: Path
    levels: Annotated[LegacyLevels | StockLevels, Field(discriminator="rules")]
    seeds: list[int]


@dataclass(frozen=True)
class Progress:
    """How far a build is.

    Attributes:
        done: levels that are in the bank.
        total: levels that are asked for.
        seconds_left: at the speed so far; none before the first chunk.
    """

    done: int
    total: int
    seconds_left: float | None


OnProgress = Callable[[Progress], None]


def build(
    root: Path,
    levels: Generated,
    seeds: Sequence[int],
    processes: int = 1,
    on_progress: OnProgress = lambda _progress: None,
) -> int:
    """Put the levels of these seeds into a bank; returns how many were missing.

    Args:
        root: the bank's folder.
        levels: the distribution.
        seeds: of the generator.
        processes: to build with; 1 builds in this one.
        on_progress: called at the start and after every chunk.

    Raises:
        BankError: the bank is damaged, or a worker failed.
        InfeasibleLevelError: a seed has no level.
    """
    bank, key = LevelBank(root), key_of(levels)
    wanted = list(dict.fromkeys(seeds))
    missing = sum(not bank.holds(key, seed) for seed in wanted)
    done, begin = len(wanted) - missing, time.monotonic()
    on_progress(Progress(done, len(wanted), 0.0 if missing == 0 else None))
    if missing == 0:
        return 0
    for count in _run(root, levels, wanted, min(processes, missing // chunk_levels(levels) + 1)):
        done = min(done + count, len(wanted))
        speed = (done - len(wanted) + missing) / max(time.monotonic() - begin, 1e-9)
        on_progress(Progress(done, len(wanted), (len(wanted) - done) / speed if speed else None))
    return missing


def build_training(
    root: Path,
    levels: Generated,
    seeds: Sequence[int],
    processes: int = 1,
    on_progress: OnProgress = lambda _progress: None,
) -> int:
    """As `build`, and the levels that stand in for those that are held out (see `common.levels.held_out`)."""
    built, wanted, key = 0, list(seeds), key_of(levels)
    held_out = HeldOut.of(levels, LevelBank(root), generate)
    origins = list(seeds)
    for attempt in range(1, TRIES + 1):
        built += build(root, levels, wanted, processes, on_progress)
        bank = LevelBank(root)
        refused = [
            origin
            for origin, seed in zip(origins, wanted, strict=True)
            if (level := bank.get(key, seed)) is not None and level in held_out
        ]
        if not refused:
            break
        origins, wanted = refused, [retry_seed(seed, attempt) for seed in refused]
    return built


def chunk_levels(levels: Generated) -> int:
    """How many levels a chunk has."""
    rows, columns, trains = levels.bounds
    return max(1, min(CHUNK_LEVELS, CHUNK_WORK // (rows * columns * trains)))


def work(root: Path, levels: Generated, seeds: Sequence[int]) -> Iterator[int]:
    """Build chunks until all are there; yields the number of new levels after each that was built here."""
    key = key_of(levels)
    folder = root / key
    folder.mkdir(parents=True, exist_ok=True)
    bank, size = LevelBank(root), chunk_levels(levels)
    waiting = [seeds[at : at + size] for at in range(0, len(seeds), size)]
    while waiting:
        busy = []
        for chunk in waiting:
            path = folder / chunk_name(levels, chunk)
            if path.exists() or all(bank.holds(key, seed) for seed in chunk):
                continue
            with _claim(path) as mine:
                if not mine:
                    busy.append(chunk)
                elif not path.exists():
                    for torn in folder.glob(f".{path.name}.*.tmp"):  # of builders that died
                        torn.unlink(missing_ok=True)
                    new = sum(not bank.holds(key, seed) for seed in chunk)
                    drawn = [bank.get(key, seed) or generate(levels, seed) for seed in chunk]
                    write_chunk(path, levels, chunk, drawn)
                    yield new
        waiting = busy
        if waiting:
            time.sleep(WAIT_S)


@contextmanager
def _claim(path: Path) -> Iterator[bool]:
    """Whether this process may build a chunk, for as long as the block lasts."""
    claim = path.with_name(f".{path.name}.claim")
    with claim.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        yield True
        claim.unlink(missing_ok=True)  # while it is locked, and only when the chunk is there


def _run(root: Path, levels: Generated, seeds: Sequence[int], processes: int) -> Iterator[int]:
    """Build with so many processes; yields the number of new levels after each chunk."""
    if processes == 1:
        yield from work(root, levels, seeds)
        return
    with tempfile.TemporaryDirectory() as scratch:
        request, complaints = Path(scratch) / "request.json", Path(scratch) / "complaints"
        content = Request(root=root.resolve(), levels=levels, seeds=list(seeds))
        request.write_text(content.model_dump_json())
        with complaints.open("wb") as errors:
            reading, writing = os.pipe()
            command = run_worker("railctl.common.levels.build", str(request))
            workers = [subprocess.Popen(command, stdout=writing, stderr=errors) for _ in range(processes)]
            os.close(writing)
            try:
                with os.fdopen(reading) as lines:  # ends with the last worker
                    yield from map(int, lines)
            finally:
                for worker in workers:
                    worker.kill()
                    worker.wait()
        bank, key = LevelBank(root), key_of(levels)
        if not all(bank.holds(key, seed) for seed in seeds):
            reason = (complaints.read_text().splitlines() or ["it was killed"])[-1]
            infeasible = reason.removeprefix(INFEASIBLE)
            if infeasible != reason:
                raise InfeasibleLevelError(infeasible)
            raise BankError(f"no worker could finish {root / key}: {reason}: build again to go on")


def main() -> None:
    """Be a worker: what to build in a file, on stdout the number of levels after each chunk."""
    parser = argparse.ArgumentParser(description="Builds levels into a bank.")
    parser.add_argument("request", type=Path, help="a file with a `Request`")
    request = Request.model_validate_json(parser.parse_args().request.read_text())
    try:
        for count in work(request.root, request.levels, request.seeds):
            os.write(1, b"%d\n" % count)  # workers share the pipe, so a line must be one write
    except InfeasibleLevelError as error:
        sys.exit(f"{INFEASIBLE}{error}")


if __name__ == "__main__":
    main()
