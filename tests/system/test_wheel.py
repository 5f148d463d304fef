"""The wheel works in a folder without the checkout: all files are in it, under one name, and a run comes to its end."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # it builds, and compiles everything anew

ROOT = Path(__file__).parents[2]
PARTS = ("adapters", "analysis", "common", "deploy", "services", "tools")
COMMAND = [sys.executable, "-P", "-c", "from railctl.deploy.cli import main; main()"]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Where the wheel is unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    sources = folder / "sources"  # building leaves a folder behind
    shutil.copytree(ROOT, sources, symlinks=True, ignore=shutil.ignore_patterns(".*", "runs", "results", "tests"))
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, sources]
    subprocess.run(build, check=True)
    [wheel] = folder.glob("railctl-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_every_file_is_in_it_and_no_other_name(installed):
    tracked = subprocess.run(["git", "ls-files", *PARTS], cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S607
    assert [name for name in tracked.stdout.split() if not (installed / "railctl" / name).is_file()] == []
    assert sorted(path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")) == ["railctl"]


def test_a_run_beside_folders_of_the_same_names(installed, tmp_path):
    for part in PARTS:
        (tmp_path / part).mkdir()
        (tmp_path / part / "__init__.py").write_text("raise SystemExit('imported what is not ours')")
    environment = os.environ | {"PYTHONPATH": str(installed), "RAILCTL_RUNS": str(tmp_path / "runs")}

    def railctl(*arguments):
        command = [*COMMAND, *arguments]
        done = subprocess.run(command, check=False, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    where = [sys.executable, "-P", "-c", "import railctl; print(railctl.__file__)"]
    found = subprocess.run(where, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert Path(found.stdout.strip()).is_relative_to(installed)
    said = railctl("up", "--episodes", "4", "--name", "first", "--set", "evaluation.every_episodes=2")
    assert "compiling, the first time only" in said
    assert (tmp_path / "runs" / "first" / "curve.png").exists()
    watched = [json.loads(memo.read_text())["stamps"] for memo in installed.rglob("*.sources.json")]
    assert {Path(path).relative_to(installed).parts[0] for stamps in watched for path in stamps} == {"railctl"}
    assert "100.0%" in railctl("evaluate", "pretrained/dispatch-easy", "--level", "easy", "--episodes", "3")
