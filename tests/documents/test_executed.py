"""Every command of README and documents is executed, as it is written, by a shell.

Only `railctl` has less to do there (`shorter.py`); what another machine, site or engine would do is done by stand-ins
that take everything; names of other machines are this one's, and what goes on until Ctrl-C is ended by it.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from railctl.deploy.follow import wait_until

pytestmark = pytest.mark.documents

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
BLOCK = re.compile(r"^```(console|sh)\n(.*?)^```", re.DOTALL | re.MULTILINE)
RAILCTL = Path(sys.executable).with_name("railctl")
ELSEWHERE = ("sbatch", "kubectl", "docker", "scp")  # commands that stand-ins carry out
UNTIL_INTERRUPTED = ("railctl tail live", "railctl tail second", "railctl watch", "railctl relay", "railctl join")
HERE = {  # what is there otherwise on one machine
    "keys create --host node1": "keys create --host localhost --relay localhost",
    "node1": "localhost",
    "--keys keys --listen tls/0.0.0.0:7447": "--keys keys --listen tls/0.0.0.0:7448",  # of the relay
    "/shared/me/": "shared/",
    "mkdir -m 700 keys": "true",
    "railctl study report thesis  ": "railctl study run thesis && railctl study report thesis  ",  # its jobs are done
}
PATIENCE_S = 400
BY_CTRL_C = 130  # the exit code of what has nothing to end cleanly
RUNS = {  # that commands name
    "demo": "--algorithm dddqn --level easy --episodes 300 --set evaluation.every_episodes=100",
    "sil-hard": "--algorithm sil --level hard --episodes 20 --set evaluation.every_episodes=20",
    **{
        f"{algorithm}-easy-{seed}": f"--algorithm {algorithm} --seed {seed} --episodes 20"
        for algorithm in ("dddqn", "ppo")
        for seed in (1, 2)
    },
}


def commands(document):
    """The commands of a document, each as it is written."""
    return [
        line.removeprefix("$ ")
        for kind, block in BLOCK.findall(document.read_text())
        for line in block.replace("\\\n", " ").splitlines()
        if kind == "sh" or line.startswith("$ ")
    ]


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """The runs that commands name, finished."""
    root = tmp_path_factory.mktemp("made")
    for name, options in RUNS.items():
        command = [RAILCTL, "up", "--name", name, *options.split(), "--set", "evaluation.levels=2"]
        subprocess.run(command, env=os.environ | {"RAILCTL_RUNS": str(root)}, check=True, stdout=subprocess.DEVNULL)
    [last] = (root / "sil-hard" / "checkpoints").glob("*20.safetensors")
    shutil.copy(last, last.with_name("00001500.safetensors"))
    return root


@pytest.fixture
def shell(tmp_path, runs):
    """A folder as a user would have it, and the environment of a shell there; what runs at the end is ended."""
    shutil.copytree(runs, tmp_path / "runs")
    for part in ("tests", ".venv"):  # what is only read
        if (ROOT / part).exists():
            (tmp_path / part).symlink_to(ROOT / part)
    (tmp_path / "rush.yaml").write_text("levels: {rush: {rules: stock, size: [30, 30], trains: 4, cities: 2}}\n")
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "railctl").write_text(f'#!/bin/sh\nexec {sys.executable} {Path(__file__).with_name("shorter.py")} "$@"\n')
    for name in ELSEWHERE:
        (tools / name).write_text("#!/bin/sh\n[ -t 0 ] || cat > /dev/null\n")
    for tool in tools.iterdir():
        tool.chmod(0o755)
    path = os.pathsep.join([str(tools), str(RAILCTL.parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "COLUMNS": "100"}
    environment.pop("RAILCTL_RUNS", None)
    yield tmp_path, environment
    for root in (tmp_path / "runs", tmp_path / "shared" / "runs"):
        for folder in root.glob("*/cluster.json"):
            down = [RAILCTL, "down", folder.parent.name]
            subprocess.run(down, env=os.environ | {"RAILCTL_RUNS": str(root)}, check=False, capture_output=True)


def shown_to_fail(document, line):
    """Whether the document itself shows that a command is refused."""
    return f"$ {line}\nrailctl: " in document.read_text()


def carry_out(line, folder, environment):
    """What a command comes to: its exit code, and all that it says."""
    with subprocess.Popen(
        ["/bin/bash", "-c", line],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        said = ""
        if line.startswith(UNTIL_INTERRUPTED):
            said = process.stdout.readline()
            os.killpg(process.pid, signal.SIGINT)
        try:
            said += process.communicate(timeout=PATIENCE_S)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return process.returncode, said


@pytest.mark.parametrize("document", [path for path in DOCUMENTS if commands(path)], ids=lambda path: path.name)
def test_what_is_written_can_be_carried_out(document, shell):
    folder, environment = shell
    settings = []  # exports hold for the commands after them
    for written in commands(document):
        line = written
        for name, here in HERE.items():
            line = line.replace(name, here)
        if line.startswith("make "):
            assert re.search(rf"^{line.split()[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), written
        elif line.startswith(("export ", ". ")):
            settings += [line] * line.startswith("export ")
        else:
            code, said = carry_out("; ".join([*settings, line]), folder, environment)
            wanted = {2} if shown_to_fail(document, written) else {0}
            if line.startswith("railctl join"):
                wanted.add(BY_CTRL_C)  # it comes before there is an actor that could leave
            assert code in wanted, f"$ {line}\n{said}"
            assert "Traceback" not in said, f"$ {line}\n{said}"
        if "railctl up" in line and "live" in line:
            assert wait_until(lambda: any(folder.glob("runs/live/checkpoints/*")), PATIENCE_S)


def test_a_command_that_fails_is_noticed(tmp_path):
    assert carry_out("railctl-nosuch", tmp_path, os.environ)[0] == 127
