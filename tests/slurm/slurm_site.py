"""Slurm for real: a controller and two nodes, all daemons of this machine, with a key and folders of their own."""

import getpass
import json
import os
import secrets
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

from railctl.common.folder import RunFolder
from railctl.deploy.follow import wait_until

RAILCTL = Path(sys.executable).with_name("railctl")
PATIENCE_S = 600.0
NOT_OF_THE_CURVE = {"actor", "acting_s", "trained_unix_s", "evaluated_unix_s", "evaluating_s"}
CONFIGURATION = """
ClusterName=railctl
SlurmctldHost={machine}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
ReturnToService=2
NodeName=node1 NodeHostname={machine} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=4 RealMemory=16000
NodeName=node2 NodeHostname={machine} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=4 RealMemory=16000
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class Site:
    """A cluster that Slurm runs, and what a user does there."""

    def __init__(self, folder: Path, runs: Path) -> None:
        self.folder, self.runs = folder, runs
        self._daemons: list[subprocess.Popen[bytes]] = []
        self.environment = os.environ | {
            "PATH": f"{RAILCTL.parent}:{os.environ['PATH']}:/usr/sbin",
            "SLURM_CONF": str(folder / "slurm.conf"),
            "RAILCTL_RUNS": str(runs),
        }

    def begin(self, stack: ExitStack) -> None:
        """Start its daemons, and have them end with the stack."""
        key = self.folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o600)
        machine = socket.gethostname().partition(".")[0]
        known = {"machine": machine, "user": getpass.getuser(), "folder": self.folder, "ports": free_ports(3)}
        (self.folder / "slurm.conf").write_text(CONFIGURATION.format(**known))
        own = [f"--{name}={self.folder}/munge.{name.partition('-')[0]}" for name in ("socket", "key-file", "pid-file")]
        own += [f"--log-file={self.folder}/munge.log", f"--seed-file={self.folder}/munge.seed"]
        stack.callback(self._end_what_is_left)
        self._daemon(stack, "munged", "--foreground", "--force", *own)
        assert wait_until((self.folder / "munge.socket").exists, PATIENCE_S)
        self._daemon(stack, "slurmctld", "-D")
        for node in ("node1", "node2"):
            self._daemon(stack, "slurmd", "-D", "-N", node)
        assert wait_until(lambda: self.said("sinfo", "--noheader", "--format=%D %t") == "2 idle", PATIENCE_S), (
            self.logs()
        )

    def _daemon(self, stack: ExitStack, name: str, *arguments: str) -> None:
        log = stack.enter_context((self.folder / f"{name}-{len(self._daemons)}.log").open("wb"))
        process = subprocess.Popen([name, *arguments], env=self.environment, stdout=log, stderr=subprocess.STDOUT)
        self._daemons.append(process)
        stack.callback(process.wait)
        stack.callback(process.terminate)

    def logs(self) -> str:
        return "\n".join(f"{path.name}:\n{path.read_text()[-3000:]}" for path in sorted(self.folder.glob("*.log")))

    def run(self, *command: str, text: str | None = None, code: int | None = 0) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, and check its exit code."""
        done = subprocess.run(
            command,
            env=self.environment,
            input=text,
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert code in (None, done.returncode), (
            f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}\n{self.logs()}"
        )
        return done

    def said(self, *command: str) -> str:
        return self.run(*command, code=None).stdout.strip()

    def railctl(self, *arguments: str) -> str:
        return self.run(str(RAILCTL), *arguments).stdout

    def submit(self, script: str) -> str:
        """The number of a new job."""
        return self.run("sbatch", "--parsable", text=script).stdout.strip()

    def state(self, job: str) -> str:
        """Of a job, or of the parts of an array."""
        return self.said("squeue", "--noheader", "--states=all", "--format=%T", f"--jobs={job}")

    def wait(self, come_true) -> None:
        assert wait_until(come_true, PATIENCE_S), self.logs()

    def curve(self, name: str) -> list[dict]:
        """Episodes and evaluations of a run, without who did them and when."""
        folder = RunFolder(self.runs / name)
        lines = [*folder.episodes_file.read_text().splitlines(), *folder.evaluations_file.read_text().splitlines()]
        return [{k: v for k, v in json.loads(line).items() if k not in NOT_OF_THE_CURVE} for line in lines]

    def _end_what_is_left(self) -> None:
        """Of jobs whose tests failed: what is left is known by the environment that it inherited."""
        mark = f"RAILCTL_RUNS={self.runs}".encode()
        for path in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if mark in path.read_bytes().split(b"\0"):
                    os.kill(int(path.parent.name), signal.SIGKILL)


def free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        servers = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [server.getsockname()[1] for server in servers]
