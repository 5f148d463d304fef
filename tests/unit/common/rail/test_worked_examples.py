"""The observation and the reward of CONTRIBUTING's examples work, in both engines, once its text is followed."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from railctl.common.interpreter import PYTHON

ROOT = Path(__file__).parents[4]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
PLAYED = """
import numpy as np
from made_rails import EAST, line
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.flatland_world import FlatlandWorld
from railctl.common.rail.observations.table import CompassObservation
from railctl.common.rail.rewards.table import SparseReward

told = {"observation": CompassObservation(scale=5), "reward": SparseReward(arrival=2), "decisions": "always"}
for engine in (CompiledWorld, FlatlandWorld):
    world = engine(1, 2, **told)
    assert world.n_features == 2
    world.load(0, line((3, EAST, 5), (2, EAST, 6)))
    for east, paid in ((0.8, [0, 0]), (0.8, [0, 0]), (0.6, [2, 0]), (0.4, [0, 0]), (0.2, [0, 2])):
        assert world.observe(0, 1).tolist() == [0, np.float32(east)], (engine, world.observe(0, 1))
        assert world.step(np.full((1, 2), 2, np.int8))[0].tolist() == paid, engine
    assert world.over()[0]
"""


def follow(section: str, root: Path) -> list[str]:
    """Do in a copy of the project what a section says; returns the files that it touches."""
    [body] = re.findall(rf"^## {section}\n(.*?)^## ", TEXT, re.DOTALL | re.MULTILINE)
    [code] = re.findall(r"^```python\n(.*?)^```", body, re.DOTALL | re.MULTILINE)
    [changes] = re.findall(r"^```diff\n(.*?)^```", body, re.DOTALL | re.MULTILINE)
    [new] = re.findall(r"`(common/rail/\w+/(?!table)\w+\.py)`", body.split("```")[0])
    (root / new).write_text(code)
    head, changes = changes.split("\n", 1)
    table = head.removeprefix("--- ")
    text = (root / table).read_text()
    for change in changes.split("@@\n"):
        lines = change.splitlines(keepends=True)
        old = "".join(line[1:] for line in lines if line[0] in " -")
        assert text.count(old) == 1, old
        text = text.replace(old, "".join(line[1:] for line in lines if line[0] in " +"))
    (root / table).write_text(text)
    return [new, table]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "common", tmp_path / "common", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_the_examples_work(copy: Path):
    touched = follow("Adding an observation", copy) + follow("Adding a reward", copy)
    assert touched == [
        "common/rail/observations/compass.py",
        "common/rail/observations/table.py",
        "common/rail/rewards/sparse.py",
        "common/rail/rewards/table.py",
    ]
    process = subprocess.run(
        [*PYTHON, "-c", PLAYED],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": f"{copy}:{Path(__file__).parent}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
