"""examples/railctl.ipynb: as it is kept it is whole and small; `make notebook` executes it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[3]
NOTEBOOK = ROOT / "examples" / "railctl.ipynb"
MOST_BYTES, MOST_S = 300_000, 300


def code_cells(path):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


def test_what_is_kept_was_executed_from_top_to_bottom_without_an_error():
    cells = code_cells(NOTEBOOK)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    assert NOTEBOOK.stat().st_size < MOST_BYTES


@pytest.mark.notebook
def test_it_runs_from_a_clean_clone_in_minutes(tmp_path):
    copy = tmp_path / NOTEBOOK.name
    copy.write_bytes(NOTEBOOK.read_bytes())
    environment = os.environ | {"PYTHONPATH": str(ROOT), "RAILCTL_RUNS": str(tmp_path / "runs")}
    begin = time.monotonic()
    jupyter = Path(sys.executable).with_name("jupyter")
    done = subprocess.run(
        [jupyter, "execute", "--inplace", copy], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - begin < MOST_S
    kept, again = ([cell.outputs[-1] for cell in code_cells(path) if cell.outputs] for path in (NOTEBOOK, copy))
    assert [output.get("text") for output in again] == [output.get("text") for output in kept]  # figures repeat
