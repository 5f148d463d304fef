"""railctl bench, from the command line to the document."""

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from railctl.common.interpreter import PYTHON
from railctl.deploy.cli import app
from railctl.deploy.commands import bench

WAITING = "import sys, time; print('ready', file=sys.stderr, flush=True); time.sleep(60)"
CALLER = """
from railctl.deploy.cli import app
from railctl.deploy.commands import bench
bench.BENCHES["waiting"] = "waiting"
app(["bench", "waiting"])
"""


def test_a_bench_prints_one_document(capfd):
    result = CliRunner().invoke(app, ["bench", "world", "--worlds", "1", "--repeats", "1", "--json"])
    assert result.exit_code == 0
    said = capfd.readouterr()
    rows = json.loads(said.out)["rows"]
    assert len(rows) == 4
    assert all(list(row) == ["name", "unit", "ours", "theirs", "ratio", "repeats"] for row in rows)
    assert "step+tree easy" in said.err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["wrold"], "unknown benchmark 'wrold': did you mean world? known are "),
        (["world", "--repeats", "0"], "--repeats 0: use a number above 0"),
        (["levels", "--worlds", "-1"], "--worlds -1: use a number above 0"),
        (["loop", "--lag", "free"], "--lag: bench loop has no use for it, leave it out"),
        (["world", "--actors", "2"], "--actors: bench world has no use for it, leave it out"),
        (["cluster", "--repeats", "3"], "--repeats: bench cluster has no use for it, leave it out"),
        (["cluster", "--episodes", "0"], "--episodes 0: use a number above 0"),
        (["loop", "--worlds", "3"], "--worlds: bench loop has no use for it, leave it out"),
        (["world", "--observation", "traffic"], "--observation: bench world has no use for it, leave it out"),
        (["replay", "--worlds", "3"], "--worlds: bench replay has no use for it, leave it out"),
    ],
)
def test_wrong_usage_is_one_line(arguments, text):
    result = CliRunner().invoke(app, ["bench", *arguments])
    assert (result.exit_code, result.stdout) == (2, "")
    [line] = result.stderr.splitlines()
    assert line.startswith(f"railctl: {text}")


@pytest.mark.parametrize(("script", "code"), [("raise SystemExit(1)", 1), ("raise SystemExit(2)", 2)])
def test_a_bench_that_fails_has_said_why(monkeypatch, tmp_path: Path, script, code):
    (tmp_path / "failing.py").write_text(script)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setitem(bench.BENCHES, "failing", "failing")
    result = CliRunner().invoke(app, ["bench", "failing"])
    assert (result.exit_code, result.output) == (code, "")


def test_a_bench_that_is_killed_is_said_in_one_line(monkeypatch, tmp_path: Path):
    (tmp_path / "killed.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setitem(bench.BENCHES, "killed", "killed")
    result = CliRunner().invoke(app, ["bench", "killed"])
    assert result.exit_code == 1
    assert result.stderr == "railctl: bench killed was killed by signal 9: run it again\n"


def test_ctrl_c_ends_both_quietly(tmp_path: Path):
    (tmp_path / "waiting.py").write_text(WAITING)
    path = os.pathsep.join([str(tmp_path), str(Path(bench.__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    with subprocess.Popen(
        [*PYTHON, "-c", CALLER],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": path},
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == b"ready\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)  # ends only when nobody holds the pipes any more
    assert (process.returncode, out, err) == (bench.BY_SIGNAL + signal.SIGINT, b"", b"")
