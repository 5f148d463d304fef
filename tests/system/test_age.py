"""What twenty minutes and fifty tails do to a run: nothing. Prints what every process held first and last."""

import itertools
import os
import signal
import sys
import threading
from pathlib import Path
from typing import NamedTuple

import pytest

from railctl.common.locks import living
from railctl.common.records.rows import EpisodeRow
from railctl.common.rows import read_rows
from railctl.deploy.follow import wait_until
from railctl.tools.bench.alone import Alone

SETTLING_MINUTES, WATCHED_MINUTES = 2, 8  # queues for who is stopped fill up; then nothing may grow
LOOKS_A_MINUTE = 3
TAILS, STOPPED = 50, 6
PATIENCE_S = 300.0
PROCESSES = ("router", "learner", "evaluator", "actor-easy-0", "actor-easy-1", "supervisor")
WARM = 1000  # episodes, by which all is compiled and the replay full
COMPARED = 300  # episodes, with one process alone
GROWTH_MB = 4.0
OPTIONS = [
    *("--algorithm", "dddqn", "--level", "easy", "--actors", "easy=2", "--episodes", "1000000", "--seed", "7"),
    *("--lag", "3", "--set", "fragment_steps=null", "--set", "dqn.learn_every_steps=20"),
    *("--set", "replay.capacity=5000", "--set", "cluster.snapshot_every_episodes=200"),
    *("--set", "evaluation.every_episodes=500", "--set", "evaluation.levels=5"),
]


class Held(NamedTuple):
    """What a process holds."""

    memory_mb: float
    handles: int
    threads: int


def held(pid):
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    handles = len(list(Path(f"/proc/{pid}/fd").iterdir()))
    return Held(int(status["VmRSS"].split()[0]) / 1024, handles, int(status["Threads"]))


def watch(clusters, name):
    """What each process holds in the first minute and in the last one, once all has settled."""
    looks = []
    threading.Event().wait(60 * SETTLING_MINUTES)
    for _ in range(WATCHED_MINUTES * LOOKS_A_MINUTE):
        threading.Event().wait(60 / LOOKS_A_MINUTE)
        looks.append({process: held(pid) for process, pid in living(clusters.folder(name)).items()})
    return least(looks[:LOOKS_A_MINUTE]), least(looks[-LOOKS_A_MINUTE:])


def least(looks):
    """For files are open for a moment, and what is waste grows from look to look."""
    return {
        process: Held(*(min(values) for values in zip(*(look[process] for look in looks), strict=True)))
        for process in looks[0]
    }


def trained(folder):
    return len(read_rows(folder.episodes_file, EpisodeRow))


class Reader:
    """Reads what a tail prints: a line a second, or all at once."""

    def __init__(self, process, *, slow):
        self.process = process
        self.began, self._ends = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._read, args=(300, 1.0) if slow else (1 << 20, 0.0))
        self._thread.start()

    def _read(self, size, pause_s):
        while os.read(self.process.stdout.fileno(), size) and not self._ends.wait(pause_s):
            self.began.set()

    def end(self):
        self._ends.set()
        self.process.kill()
        self._thread.join()


@pytest.mark.slow
def test_neither_age_nor_tails_wear_a_run(clusters, capsys):
    clusters.railctl("up", "--name", "aged", "--detach", *OPTIONS)
    folder, readers = clusters.folder("aged"), []
    try:
        assert wait_until(lambda: trained(folder) >= WARM and len(living(folder)) == len(PROCESSES), 4 * PATIENCE_S)
        pids, alone = living(folder), watch(clusters, "aged")
        readers += [Reader(clusters.start("tail", "aged", "--json"), slow=number == STOPPED) for number in range(TAILS)]
        for reader in readers:
            assert reader.began.wait(PATIENCE_S)
        for reader in readers[:STOPPED]:
            reader.process.send_signal(signal.SIGSTOP)
        watched = watch(clusters, "aged")
        assert living(folder) == pids  # nobody was started anew
    finally:
        for reader in readers:
            reader.end()
        clusters.railctl("down", "aged")
    with capsys.disabled():
        sys.stdout.write(f"{trained(folder)} episodes{table(alone, watched)}")
    for first, last in (alone, watched):
        for process, (memory_mb, handles, threads) in first.items():
            assert last[process].memory_mb < memory_mb + GROWTH_MB, process
            assert last[process].handles <= handles, process
            assert last[process].threads <= threads, process
    rows = [row for row in clusters.curve("aged") if "digest" in row]
    undisturbed = itertools.islice(Alone(folder.config()).train(), COMPARED)
    assert [row["digest"] for row in rows[:COMPARED]] == [episode.digest for episode in undisturbed]


def table(*stretches):
    """Of each process what it held in the first and in the last minute of each stretch."""
    lines = ["", "process: MB, handles, threads in the first and in the last minute, alone; the same with tails"]
    for process in stretches[0][0]:
        figures = " | ".join("{:.1f} {:g} {:g}".format(*look[process]) for stretch in stretches for look in stretch)
        lines.append(f"{process}: {figures}")
    return "\n".join([*lines, ""])
