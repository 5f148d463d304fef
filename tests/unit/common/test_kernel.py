"""Compiled code is kept, and made anew when anything has changed that it is made of."""

import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from common import compiling as compiling_module
from common import kernel as kernel_module
from common.interpreter import PYTHON
from common.kernel import bare_kernel, kernel

ONE = "from common.kernel import kernel\n\n\n@kernel\ndef one() -> int:\n    return 1\n"
TWO = ONE.replace("def one() -> int:\n    return 1", "def two() -> int:\n    return one() + 1").replace(
    "kernel\n\n", "kernel\nfrom other.between import one\n\n", 1
)
RUN = "from common.tiny.two import two; print(two(), len(two.stats.cache_hits))"


def run_in(root: Path) -> list[str]:
    process = subprocess.run([sys.executable, "-c", RUN], cwd=root, capture_output=True, text=True, check=True)
    return process.stdout.split()


def test_code_follows_a_function_of_another_file(tmp_path: Path):
    tiny = tmp_path / "common" / "tiny"
    tiny.mkdir(parents=True)
    for module in (kernel_module, compiling_module):
        shutil.copy(module.__file__, tmp_path / "common")
    other = tmp_path / "other"
    other.mkdir()
    (tiny / "one.py").write_text(ONE)
    (other / "between.py").write_text("from common.tiny import one as module\n\none = module.one\n")
    (tiny / "two.py").write_text(TWO)
    assert run_in(tmp_path) == ["2", "0"]
    assert run_in(tmp_path) == ["2", "1"]
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


def test_numbas_own_setting_is_put_back(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "InTreeCacheLocator")
    assert kernel(_sum_of)(np.ones(2)) == 2
    assert numba.config.CACHE_LOCATOR_CLASSES == "InTreeCacheLocator"


LIGHT = """
import sys
from common.rail.compiled.paths import count_bits
print(count_bits.py_func(5), "numba" in sys.modules, count_bits(5), "numba" in sys.modules)
"""


def test_numba_is_imported_only_for_what_is_called():
    said = subprocess.run([*PYTHON, "-c", LIGHT], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["2", "False", "2", "True"]
