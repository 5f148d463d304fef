"""The example that trains stable-baselines3, in its own command: its packages are not installed for all tests."""

import re

import pytest
from terminal import ROOT, run_command

from railctl.common.interpreter import PYTHON


@pytest.mark.sb3
def test_the_example_trains_and_says_what_came_of_it(tmp_path):
    arguments = ["--steps", "6000", "--copies", "2", "--episodes", "3"]
    done = run_command(tmp_path, *PYTHON, str(ROOT / "examples" / "train_sb3.py"), *arguments)
    assert done.returncode == 0, done.stderr
    before, trained, after = done.stdout.splitlines()
    returns = r": mean normalised return -\d\.\d{3} sampled, -\d\.\d{3} greedy, 3 levels"
    assert re.fullmatch("untrained" + returns, before)
    assert re.fullmatch(r"6144 steps in \d+ s", trained)
    assert re.fullmatch("trained" + returns, after)
    assert before.split(": ")[1] != after.split(": ")[1]
