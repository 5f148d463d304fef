"""Compiled code is kept, made anew when anything has changed that it is made of, and made by one process alone."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from railctl.common import compile_signs, compiling, sources
from railctl.common import kernel as kernel_module
from railctl.common.interpreter import PYTHON
from railctl.common.kernel import bare_kernel

ROOT = Path(__file__).parents[3]

ONE = "from railctl.common.kernel import kernel\n\n\n@kernel\ndef one() -> int:\n    return 1\n"
TWO = ONE.replace("def one() -> int:\n    return 1", "def two() -> int:\n    return one() + 1").replace(
    "kernel\n\n", "kernel\nfrom railctl.other.between import one\n\n", 1
)
RUN = "from railctl.common.tiny.two import two; print(two(), len(two.stats.cache_hits))"


def run_in(root: Path) -> list[str]:
    process = subprocess.run([sys.executable, "-c", RUN], cwd=root, capture_output=True, text=True, check=True)
    return process.stdout.split()


def test_code_follows_a_function_of_another_file(tmp_path: Path):
    tiny = tmp_path / "railctl" / "common" / "tiny"
    tiny.mkdir(parents=True)
    for module in (kernel_module, compiling, compile_signs, sources):
        shutil.copy(module.__file__, tiny.parent)
    for package in (tiny.parent, tiny.parents[1]):
        (package / "__init__.py").touch()
    other = tmp_path / "railctl" / "other"
    other.mkdir()
    (tiny / "one.py").write_text(ONE)
    (other / "between.py").write_text("from railctl.common.tiny import one as module\n\none = module.one\n")
    (tiny / "two.py").write_text(TWO)
    assert run_in(tmp_path) == ["2", "0"]
    (tiny / "three.py").write_text("")  # nobody imports it
    assert run_in(tmp_path) == ["2", "1"]
    (tiny / "one.py").write_text(ONE.replace("return 1", "return 5"))
    assert run_in(tmp_path) == ["6", "0"]


def test_a_bare_kernel_makes_no_arrays():
    assert bare_kernel(_sum_of)(np.ones(3)) == 3
    with pytest.raises(numba.core.errors.NumbaError, match="array"):
        bare_kernel(_ones)(3)


def _sum_of(numbers: np.ndarray) -> float:
    return numbers.sum()


def _ones(count: int) -> np.ndarray:
    return np.ones(count)


LIGHT = """
import sys
from railctl.common.rail.compiled.paths import count_bits
print(count_bits.py_func(5), "numba" in sys.modules, count_bits(5), "numba" in sys.modules)
"""


def test_numba_is_imported_only_for_what_is_called():
    said = subprocess.run([*PYTHON, "-c", LIGHT], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["2", "False", "2", "True"]


def test_what_cannot_be_compiled_keeps_nobody_waiting(tmp_path: Path):
    (tmp_path / "typed.py").write_text(
        "from railctl.common.kernel import kernel\n\n\n@kernel\ndef plus_one(of):\n    return of + 1\n"
    )
    script = (
        "import pytest, numba\nfrom typed import plus_one\nwith pytest.raises(numba.core.errors.NumbaError):\n"
        "    plus_one('one')\nprint('fails', flush=True)\ninput()"
    )
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    with subprocess.Popen(
        [*PYTHON, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as failing:
        assert failing.stdout.readline() == "fails\n"
        other = subprocess.run(
            [*PYTHON, "-c", "from typed import plus_one; print(plus_one(1))"],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
        assert other.stdout == "2\n"
        failing.communicate("\n")


COMPILE = """
import sys, time
from contextlib import contextmanager
from railctl.common.compile_signs import around_compiling
from slow import slow

@contextmanager
def around(function):
    print("begins", function, flush=True)
    yield
    print("ends", flush=True)

with around_compiling(around):
    print("says", slow(2.0), len(slow.stats.cache_hits), flush=True)
"""


def test_of_two_processes_one_compiles_and_the_other_waits_and_loads(tmp_path: Path):
    """The lock is this test's own at first, so that both have to wait for it, and neither is quicker."""
    (tmp_path / "slow.py").write_text(
        "from railctl.common.kernel import kernel\n\n\n@kernel\ndef slow(of: float) -> float:\n    return of * 2\n"
    )
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    held = (cache / "slow.slow-4.py311.lock").open("w")
    compiling.lock(held)
    both = [
        subprocess.Popen([*PYTHON, "-c", COMPILE], stdout=subprocess.PIPE, text=True, env=environment) for _ in range(2)
    ]
    for process in both:
        assert process.stdout.readline() == "begins slow\n"
    held.close()
    said = sorted(process.communicate(timeout=60)[0].splitlines() for process in both)
    assert said == [["ends", "says 4.0 0"], ["ends", "says 4.0 1"]]
    assert all(process.returncode == 0 for process in both)
    third = subprocess.run([*PYTHON, "-c", COMPILE], capture_output=True, text=True, check=True, env=environment)
    assert third.stdout == "says 4.0 1\n"  # what is compiled already does not count as compiling
