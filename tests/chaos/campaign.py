"""Faults, one after another, upon runs that must come to the curve of one that nobody disturbs, if they have one.

    python tests/chaos/campaign.py --case dddqn --seed 1 --faults 250

A run is started, disturbed until it is over, and compared; then another, until all faults have happened. The same seed
gives the same faults in the same order.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from faults import Fault, drawn  # noqa: E402
from inject import inject  # noqa: E402
from strangers import Gone, Stranger, stranger  # noqa: E402

from railctl.common.config import RunConfig  # noqa: E402
from railctl.common.folder import RunFolder  # noqa: E402  (the project's root first)
from railctl.common.locks import holder, living  # noqa: E402
from railctl.common.records.rows import EpisodeRow  # noqa: E402
from railctl.common.rows import read_rows  # noqa: E402
from railctl.deploy.runs import supervised  # noqa: E402
from railctl.tools.bench.alone import Alone  # noqa: E402

RAILCTL = Path(sys.executable).with_name("railctl")
PATIENCE_S = 300.0
LOOK_S = 0.05
HEARD = 200  # messages that a stranger has to play with
HANG_TIMEOUT_S = 5.0
COMMON = [
    *("--level", "easy", "--set", "evaluation.every_episodes=50", "--set", "evaluation.levels=2"),
    *("--set", "cluster.snapshot_every_episodes=4", "--set", f"cluster.hang_timeout_s={HANG_TIMEOUT_S:g}"),
    *("--set", "cluster.max_restarts=1000000"),
]
SMALL = ["--set", "dqn.batch_size=32", "--set", "dqn.learn_every_steps=8"]
CASES = {
    "dddqn": ["--algorithm", "dddqn", *SMALL, "--set", "fragment_steps=50"],
    "dddqn-lag": ["--algorithm", "dddqn", *SMALL, "--set", "fragment_steps=null", "--lag", "3"],
    "sil": ["--algorithm", "sil"],
    "ppo-lag": ["--algorithm", "ppo", "--lag", "3"],
    "ppo-free": ["--algorithm", "ppo", "--lag", "free", "--set", "max_staleness=6"],
}


class Stuck(Exception):  # noqa: N818  (the finding of a campaign)
    """A run did not go on after a fault."""


@dataclass
class Findings:
    """What became of faults, and of the episodes of disturbed runs."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)  # kind of fault, outcome
    rounds: int = 0
    episodes: int = 0
    lost: int = 0
    counted_twice: int = 0
    different: int = 0
    orphans: int = 0

    @property
    def survived(self) -> int:
        """Faults after which the run went on."""
        return sum(self.outcomes.values())

    @property
    def clean(self) -> bool:
        """No episode was lost, counted twice or other than undisturbed, and no process left behind."""
        return not (self.lost or self.counted_twice or self.different or self.orphans)


class Campaign:
    """Runs of one case in a folder, and what happens to them."""

    def __init__(self, root: Path, case: str, seed: int, episodes: int, say: Callable[[str], None]) -> None:
        self._root = root
        self._case = case
        self._seed = seed
        self._episodes = episodes
        self._say = say
        self._environment = os.environ | {"RAILCTL_RUNS": str(root)}
        self.findings = Findings()

    def carry_out(self, faults: Sequence[Fault]) -> Findings:
        """All of them, in as many runs as they take.

        Raises:
            Stuck: a run did not go on.
        """
        waiting = list(reversed(faults))
        while waiting:
            run = RunFolder(self._root / f"{self._case}-{self._seed}-{self.findings.rounds}")
            try:
                self._up(run, "--actors", "easy=3", *self._options)
                self._disturb(run, waiting)
                self._finish(run)
            finally:
                _kill_all(run)
            self._compare(run)
        return self.findings

    @property
    def _options(self) -> list[str]:
        seed = self._seed + self.findings.rounds
        return [*COMMON, *CASES[self._case], "--episodes", str(self._episodes), "--seed", str(seed)]

    def _up(self, run: RunFolder, *options: str) -> None:
        command = [str(RAILCTL), "up", "--name", run.path.name, "--detach", *options]
        done = subprocess.run(command, cwd=ROOT, env=self._environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Stuck(f"{run.path.name}: {done.stdout}{done.stderr}")

    def _disturb(self, run: RunFolder, waiting: list[Fault]) -> None:
        """Until there are no more faults, or the run is over; where it was taken up again it may have a new socket."""
        heard: deque[bytes] = deque(maxlen=HEARD)
        resumed = 1
        while resumed and supervised(run):
            resumed = 0
            with suppress(Gone), stranger(*run.endpoint_and_namespace(), heard) as intruder:
                while not resumed and waiting and self._reaches(run, _trained(run) + waiting[-1].after):
                    resumed = self._meet(run, waiting.pop(), intruder)

    def _meet(self, run: RunFolder, fault: Fault, intruder: Stranger) -> int:
        """One fault; returns how often the run had to be taken up again."""
        trained, before = _trained(run), living(run)
        met = inject(fault, run, intruder, HANG_TIMEOUT_S)
        resumed = self._goes_on(run, trained)
        outcome = self._outcome(before, living(run), resumed=resumed)
        self.findings.outcomes[fault.kind, outcome] += 1
        self._say(f"{self.findings.survived:5} {_trained(run):5}  {fault.kind} ({met}): {outcome}")
        return resumed

    def _reaches(self, run: RunFolder, episodes: int) -> bool:
        """Wait until so many are trained; False: the run is over before."""
        self._wait(run, lambda: _trained(run) >= min(episodes, self._episodes) or not supervised(run))
        return _trained(run) < self._episodes

    def _goes_on(self, run: RunFolder, trained: int) -> int:
        """Wait for the next episode, and take the run up again where it has stopped; returns how often."""
        resumed = 0
        while True:
            self._wait(run, lambda: _trained(run) > trained or not supervised(run))
            if supervised(run) or _is_finished(run):
                return resumed
            self._say(f"      {run.path.name} {_why(run)}")
            self._up(run)
            resumed += 1

    def _outcome(self, before: dict[str, int], after: dict[str, int], *, resumed: int) -> str:
        if resumed:
            return "stopped, taken up again"
        new = any(after.get(name, pid) != pid for name, pid in before.items())
        return "started anew" if new else "went on"

    def _finish(self, run: RunFolder) -> None:
        while True:
            self._wait(run, lambda: not supervised(run))
            if _is_finished(run):
                return
            self._up(run)

    def _wait(self, run: RunFolder, come_true: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not come_true():
            if time.monotonic() > deadline:
                raise Stuck(f"{run.path} did not go on within {PATIENCE_S:g} s, at episode {_trained(run)}")
            time.sleep(LOOK_S)

    def _compare(self, run: RunFolder) -> None:
        found, rows, config = self.findings, read_rows(run.episodes_file, EpisodeRow), run.config()
        times = Counter(row.episode for row in rows)
        found.rounds += 1
        found.episodes += config.episodes
        found.lost += sum(episode not in times for episode in range(config.episodes))
        found.counted_twice += sum(count - 1 for count in times.values())
        found.different += too_stale(rows, config) if config.is_free else other_than_alone(rows, config)
        found.orphans += sum(str(run.path) in command for command in _commands())
        if found.clean:
            shutil.rmtree(run.path)


def other_than_alone(rows: Sequence[EpisodeRow], config: RunConfig) -> int:
    """How many episodes are other than those of one process that nobody disturbs."""
    expected = [(episode.digest, episode.steps) for episode in Alone(config).run()]
    return sum((row.digest, row.steps) != expected[row.episode] for row in rows)


def too_stale(rows: Sequence[EpisodeRow], config: RunConfig) -> int:
    """How many episodes of a free run, which has no curve to compare, are staler than it promises."""
    return sum(row.staleness not in range(config.most_ahead + 1) for row in rows)


def _trained(run: RunFolder) -> int:
    return len(read_rows(run.episodes_file, EpisodeRow))


def _is_finished(run: RunFolder) -> bool:
    return (outcome := run.outcome()) is not None and outcome.outcome == "finished"


def _why(run: RunFolder) -> str:
    """How a run ended that its supervisor has left."""
    outcome = run.outcome()
    return "lost its supervisor" if outcome is None else f"{outcome.outcome}: {outcome.reason}"


def _kill_all(run: RunFolder) -> None:
    """Of a run that did not end by itself; the supervisor first, which would start the others anew."""
    for name in ("supervisor", *living(run)):
        if pid := holder(run, name):
            os.kill(pid, signal.SIGKILL)


def _commands() -> list[str]:
    """Of all processes but this one."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if path.parent.name != str(os.getpid()):
                found.append(path.read_text().replace("\0", " "))
        except OSError:
            continue
    return found


def table(findings: Findings) -> str:
    """Fault by outcome, in Markdown, and what became of the episodes."""
    outcomes = ["went on", "started anew", "stopped, taken up again"]
    kinds = list(dict.fromkeys(kind for kind, _ in findings.outcomes))
    lines = [f"| fault | {' | '.join(outcomes)} |", "|---|" + "---:|" * len(outcomes)]
    for kind in sorted(kinds):
        counts = [findings.outcomes[kind, outcome] for outcome in outcomes]
        lines.append(f"| {kind} | {' | '.join(str(count or '') for count in counts)} |")
    return "\n".join(lines) + (
        f"\n\n{findings.survived} faults survived in {findings.rounds} runs of {findings.episodes} episodes in all: "
        f"{findings.lost} lost, {findings.counted_twice} counted twice, {findings.different} different, "
        f"{findings.orphans} processes left behind.\n"
    )


def main() -> None:
    """Carry out a campaign and print its table; ends with 1 if a run was changed or did not go on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=CASES, action="append", help="all, if none is given")
    parser.add_argument("--seed", type=int, default=1, help="of faults and runs")
    parser.add_argument("--faults", type=int, default=50, help="of each case")
    parser.add_argument("--episodes", type=int, default=200, help="of each run")
    arguments = parser.parse_args()
    root = Path(tempfile.mkdtemp(prefix="railctl-chaos-"))
    all_found = Findings()
    for case in arguments.case or CASES:
        print(f"{case}, seed {arguments.seed}: {arguments.faults} faults", flush=True)
        campaign = Campaign(root, case, arguments.seed, arguments.episodes, lambda text: print(text, flush=True))
        campaign.findings = all_found
        campaign.carry_out(drawn(arguments.seed, arguments.faults))
    print(f"\n{table(all_found)}")
    if not all_found.clean:
        sys.exit(f"runs that were changed lie in {root}")
    shutil.rmtree(root)


if __name__ == "__main__":
    main()
