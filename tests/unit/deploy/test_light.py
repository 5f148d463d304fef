"""The command line answers at once: nothing that takes long to import is imported by it, or by configurations."""

import subprocess

import pytest

from railctl.common.interpreter import PYTHON

HEAVY = ("torch", "flatland", "numba", "scipy", "matplotlib", "services", "tools")


def imported_by(code):
    """Which of the heavy modules a fresh process has after running this."""
    ask = f"import sys\n{code}\nprint(*(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([*PYTHON, "-c", ask], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    "code",
    [
        "import railctl.common.config",
        "import railctl.deploy.cli",
        "import railctl.deploy.supervise",
        "import railctl.deploy.resolve as r; r.resolve({'algorithm': 'sil', 'observation': 'global'})",
        "from railctl.analysis.study import planned_runs",
    ],
)
def test_the_command_line_imports_nothing_heavy(code):
    assert imported_by(code) == []


@pytest.mark.parametrize("arguments", [["--help"], ["levels", "--help"], ["nosuch"]])
def test_help_imports_no_verb(arguments):
    code = (
        f"from typer.testing import CliRunner; from railctl.deploy.cli import app; CliRunner().invoke(app, {arguments})"
    )
    heavy = ("railctl.deploy.commands.", "railctl.common.", "numpy", "zenoh")
    loaded = f"print(*(name for name in sys.modules if name.startswith({heavy})))"
    done = subprocess.run([*PYTHON, "-c", f"import sys; {code}; {loaded}"], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) <= {"railctl.common.text", "railctl.deploy.commands.levels"}


def test_what_is_heavy_is_noticed():
    assert imported_by("import scipy.special") == ["scipy"]
