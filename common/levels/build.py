"""Filling a level bank, with any number of processes and builders at once; `python -m common.levels.build` is a worker.

A request (a difficulty and seeds) is cut into chunks in the same way by everybody. A worker goes through them, skips
those whose files are there, claims one by a lock that the kernel frees when its holder dies, generates its levels and
puts the file in place. So workers need not know of each other, a kill at any point loses no more than the chunks in
hand, and building the same again only adds what is missing.
"""

import argparse
import fcntl
import gc
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from common.interpreter import run_module
from common.levels.bank import LevelBank
from common.levels.chunks import BankError, chunk_name, write_chunk
from common.levels.held_out import TRIES, is_held_out, retry_seed
from common.levels.level import Level

CHUNK_LEVELS = 128
WAIT_S = 0.1  # for chunks that another builder has in hand


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
    difficulty: str,
    seeds: Sequence[int],
    processes: int = 1,
    on_progress: OnProgress = lambda _progress: None,
) -> int:
    """Put the levels of these seeds into a bank; returns how many were missing.

    Args:
        root: the bank's folder.
        difficulty: of all levels.
        seeds: of the generator.
        processes: to build with; 1 builds in this one.
        on_progress: called at the start and after every chunk.

    Raises:
        BankError: the bank is damaged, or a worker failed.
    """
    bank = LevelBank(root)
    wanted = list(dict.fromkeys(seeds))
    missing = sum(not bank.holds(difficulty, seed) for seed in wanted)
    done, begin = len(wanted) - missing, time.monotonic()
    on_progress(Progress(done, len(wanted), 0.0 if missing == 0 else None))
    if missing == 0:
        return 0
    for count in _run(root, difficulty, wanted, min(processes, missing // CHUNK_LEVELS + 1)):
        done = min(done + count, len(wanted))
        speed = (done - len(wanted) + missing) / max(time.monotonic() - begin, 1e-9)
        on_progress(Progress(done, len(wanted), (len(wanted) - done) / speed if speed else None))
    return missing


def build_training(
    root: Path,
    difficulty: str,
    seeds: Sequence[int],
    processes: int = 1,
    on_progress: OnProgress = lambda _progress: None,
) -> int:
    """As `build`, and the levels that stand in for those that are held out (see `common.levels.held_out`)."""
    built, wanted = 0, list(seeds)
    origins = list(seeds)
    for attempt in range(1, TRIES + 1):
        built += build(root, difficulty, wanted, processes, on_progress)
        bank = LevelBank(root)
        refused = [
            origin
            for origin, seed in zip(origins, wanted, strict=True)
            if (level := bank.get(difficulty, seed)) is not None and is_held_out(level)
        ]
        if not refused:
            break
        origins, wanted = refused, [retry_seed(seed, attempt) for seed in refused]
    return built


def work(root: Path, difficulty: str, seeds: Sequence[int]) -> Iterator[int]:
    """Build chunks until all are there; yields the number of new levels after each that was built here."""
    folder = root / difficulty
    folder.mkdir(parents=True, exist_ok=True)
    bank = LevelBank(root)
    waiting = [seeds[at : at + CHUNK_LEVELS] for at in range(0, len(seeds), CHUNK_LEVELS)]
    while waiting:
        busy = []
        for chunk in waiting:
            path = folder / chunk_name(difficulty, chunk)
            if path.exists() or all(bank.holds(difficulty, seed) for seed in chunk):
                continue
            with _claim(path) as mine:
                if not mine:
                    busy.append(chunk)
                elif not path.exists():
                    for torn in folder.glob(f".{path.name}.*.tmp"):  # of builders that died
                        torn.unlink(missing_ok=True)
                    new = sum(not bank.holds(difficulty, seed) for seed in chunk)
                    write_chunk(path, difficulty, chunk, [_level(bank, difficulty, seed) for seed in chunk])
                    yield new
        waiting = busy
        if waiting:
            time.sleep(WAIT_S)


def _level(bank: LevelBank, difficulty: str, seed: int) -> Level:
    from common.levels.legacy import generate  # noqa: PLC0415  (workers import flatland, who starts them need not)

    return bank.get(difficulty, seed) or generate(difficulty, seed)


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


def _run(root: Path, difficulty: str, seeds: Sequence[int], processes: int) -> Iterator[int]:
    """Build with so many processes; yields the number of new levels after each chunk."""
    if processes == 1:
        yield from _collecting_garbage_by_chunk(work(root, difficulty, seeds))
        return
    with tempfile.TemporaryDirectory() as scratch:
        request, complaints = Path(scratch) / "request.json", Path(scratch) / "complaints"
        request.write_text(json.dumps({"root": str(root.resolve()), "difficulty": difficulty, "seeds": list(seeds)}))
        with complaints.open("wb") as errors:
            reading, writing = os.pipe()
            command = run_module("common.levels.build", str(request))
            workers = [subprocess.Popen(command, stdout=writing, stderr=errors) for _ in range(processes)]
            os.close(writing)
            try:
                with os.fdopen(reading) as lines:  # ends with the last worker
                    yield from map(int, lines)
            finally:
                for worker in workers:
                    worker.kill()
                    worker.wait()
        bank = LevelBank(root)
        if not all(bank.holds(difficulty, seed) for seed in seeds):
            reason = (complaints.read_text().splitlines() or ["it was killed"])[-1]
            raise BankError(f"no worker could finish {root / difficulty}: {reason}: build again to go on")


def _collecting_garbage_by_chunk(counts: Iterator[int]) -> Iterator[int]:
    """The same counts, with the collector off in between: it finds next to nothing, in a twentieth of the time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        for count in counts:
            gc.collect()
            yield count
    finally:
        if was_on:
            gc.enable()


def main() -> None:
    """Be a worker: what to build in a file, on stdout the number of levels after each chunk."""
    parser = argparse.ArgumentParser(description="Builds levels into a bank.")
    parser.add_argument("request", type=Path, help='a file of {"root": ..., "difficulty": ..., "seeds": [...]}')
    request = json.loads(parser.parse_args().request.read_text())
    for count in _collecting_garbage_by_chunk(work(Path(request["root"]), request["difficulty"], request["seeds"])):
        os.write(1, b"%d\n" % count)  # workers share the pipe, so a line must be one write


if __name__ == "__main__":
    main()
