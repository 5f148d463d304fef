"""The set-up of torch happens once a process, so each case has a process of its own."""

import os
import subprocess

from railctl.common.interpreter import PYTHON

CODE = """
from railctl.common.policy.determinism import deterministic_torch
deterministic_torch()
deterministic_torch()  # harmless
import torch
print(torch.get_num_threads(), torch.get_num_interop_threads(), torch.are_deterministic_algorithms_enabled())
"""


def run(**variables):
    environment = {name: value for name, value in os.environ.items() if name != "MKL_CBWR"}
    return subprocess.run(
        [*PYTHON, "-c", CODE], env=environment | variables, capture_output=True, text=True, check=False
    )


def test_one_thread_and_deterministic_kernels():
    result = run(MKL_CBWR="AUTO,STRICT")
    assert result.stdout.split() == ["1", "1", "True"], result.stderr


def test_the_missing_variable_is_named_with_its_remedy():
    result = run()
    assert result.returncode != 0
    last = result.stderr.strip().splitlines()[-1]
    assert "MKL_CBWR is not set: start this process with MKL_CBWR=AUTO,STRICT" in last
