"""Real clusters: real processes, real Zenoh, driven through the command line as a user would."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal

import pytest
from typer.testing import CliRunner, Result

from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.records.control import LearnerCommand
from railctl.common.wire import keys
from railctl.deploy.cli import app
from railctl.deploy.follow import wait_until
from railctl.deploy.runs import reach

RAILCTL = Path(sys.executable).with_name("railctl")
PATIENCE_S = 300.0
EPISODES = 40
OPTIONS = (
    f"--level easy --episodes {EPISODES} --seed 7 --set evaluation.every_episodes=20 "
    "--set evaluation.levels=2 --set cluster.snapshot_every_episodes=4"
).split()
DQN_OPTIONS = ["--set", "dqn.batch_size=32", "--set", "dqn.learn_every_steps=8", "--set", "fragment_steps=100"]
NOT_OF_THE_CURVE = {"actor", "acting_s", "trained_unix_s", "evaluated_unix_s", "evaluating_s"}


class Clusters:
    """Runs in a folder of their own, and what a user does with them."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.options = [*OPTIONS, *DQN_OPTIONS]
        self.environment = os.environ | {"RAILCTL_RUNS": str(root), "COLUMNS": "200"}
        self._started: list[subprocess.Popen[str]] = []

    def folder(self, name: str) -> RunFolder:
        return RunFolder(self.root / name)

    def railctl(self, *arguments: str, code: int = 0, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, in some folder, and check its exit code."""
        done = subprocess.run(
            [RAILCTL, *arguments],
            cwd=cwd,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == code, f"{arguments}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done

    def up(self, name: str, *options: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        """Start a small run of dddqn."""
        return self.railctl("up", "--name", name, *self.options, *options, code=code)

    def up_any(self, name: str, *options: str) -> None:
        """Start a small run of any algorithm."""
        self.railctl("up", "--name", name, *OPTIONS, *options)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command that goes on."""
        return self.start_by((), *arguments)

    def start_by(self, before: Sequence[str], *arguments: str) -> subprocess.Popen[str]:
        """The same, by a command that starts others."""
        process = subprocess.Popen(
            [*before, RAILCTL, *arguments],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._started.append(process)
        return process

    def wait(self, come_true: Callable[[], bool]) -> None:
        """Wait for something that must come true, however busy the machine is."""
        assert wait_until(come_true, PATIENCE_S)

    def railctl_here(self, *arguments: str, code: int = 0) -> Result:
        """The same in this process: of no use to what is about processes, but a second cheaper."""
        done = CliRunner().invoke(app, arguments, env=self.environment)
        assert done.exit_code == code, f"{arguments}: {done.exit_code}\n{done.output}"
        return done

    def status(self, name: str) -> dict:
        return json.loads(self.railctl_here("status", name, "--json").stdout)

    def pause(self, name: str) -> None:
        """Hold a run as `railctl pause` does, but at once: starting a command takes as long as the rest of the run."""
        self.tell_learner(name, "pause")

    def tell_learner(self, name: str, verb: Literal["pause", "resume"]) -> None:
        with reach(self.folder(name)) as bus:
            assert bus.ask(keys.COMMAND_LEARNER, LearnerCommand(verb=verb), PATIENCE_S).done

    def goes_on_paused(self, name: str) -> None:
        """Take up a run that was paused, and let it run to its end."""
        self.railctl("up", "--name", name, "--detach")
        self.wait(lambda: self.status(name)["state"] == "paused")  # its learner is there
        self.tell_learner(name, "resume")

    def kill(self, name: str, process: str, number: signal.Signals = signal.SIGKILL) -> None:
        self.wait(lambda: process in living(self.folder(name)))  # or it has not come back from the kill before
        os.kill(living(self.folder(name))[process], number)

    def curve(self, name: str) -> list[dict]:
        """Episodes and evaluations without who did them and when."""
        folder = self.folder(name)
        lines = [*folder.episodes_file.read_text().splitlines(), *folder.evaluations_file.read_text().splitlines()]
        return [{k: v for k, v in json.loads(line).items() if k not in NOT_OF_THE_CURVE} for line in lines]

    def actors(self, name: str) -> set[str]:
        """Who acted the episodes of a curve."""
        return {json.loads(row)["actor"] for row in self.folder(name).episodes_file.read_text().splitlines()}

    def end(self) -> None:
        """Leave no process behind, whatever happened."""
        while processes := self._processes():
            for pid in processes:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            wait_until(lambda: not self._processes(), 1.0)
        for process in self._started:
            if not process.stdout.closed:
                process.communicate()

    def _processes(self) -> list[int]:
        """All that were started for these runs, by the environment that they inherit: some have no lock yet."""
        mark = f"RAILCTL_RUNS={self.root}".encode()
        found = []
        for path in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):  # another user's, or gone meanwhile
                if mark in path.read_bytes().split(b"\0"):
                    found.append(int(path.parent.name))
        return found


class Tail:
    """The rows of a run as `railctl tail --json` prints them; reading one waits for it."""

    def __init__(self, clusters: Clusters, name: str) -> None:
        self.process = clusters.start("tail", name, "--json")
        self.rows: list[dict] = []
        self._watchdog = threading.Timer(PATIENCE_S, self.process.kill)
        self._watchdog.daemon = True
        self._watchdog.start()

    def until(self, episodes: int) -> None:
        """Read on until so many episodes were seen."""
        while len(self.episodes) < episodes:
            line = self.process.stdout.readline()
            assert line, f"the tail ended after {len(self.episodes)} episodes: {self.process.stderr.read()}"
            self.rows.append(json.loads(line))

    def rest(self) -> None:
        """Read to the end of the run."""
        self.rows += [json.loads(line) for line in self.process.stdout]  # communicate() would lose what is buffered

    def close(self) -> None:
        """End the command if it goes on."""
        self._watchdog.cancel()
        if not self.process.stdout.closed:
            self.process.kill()
            self.process.communicate()

    @property
    def episodes(self) -> list[int]:
        return [row["episode"] for row in self.rows if "actor" in row]

    @property
    def evaluations(self) -> list[int]:
        return [row["episode"] for row in self.rows if "actor" not in row]


@pytest.fixture(scope="session")
def clusters(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Clusters]:
    clusters = Clusters(tmp_path_factory.mktemp("runs"))
    yield clusters
    clusters.end()


@pytest.fixture
def tail(clusters: Clusters) -> Iterator[Callable[[str], Tail]]:
    """Follows runs through `railctl tail --json`."""
    tails: list[Tail] = []

    def follow(name: str) -> Tail:
        tails.append(Tail(clusters, name))
        return tails[-1]

    yield follow
    for one in tails:
        one.close()


@pytest.fixture(scope="session")
def undisturbed(clusters: Clusters) -> list[dict]:
    """The curve of the small run that its learner acts, and nothing killed."""
    output = clusters.up("undisturbed").stdout
    assert "Summary" in output
    assert clusters.folder("undisturbed").curve_file.exists()
    curve = clusters.curve("undisturbed")
    assert len(curve) == EPISODES + 2
    assert len({row["digest"] for row in curve[:EPISODES]}) == EPISODES
    return curve
