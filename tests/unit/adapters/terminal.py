"""What a user has at hand: commands that find the package."""

import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

from click.testing import CliRunner

ROOT = Path(__file__).parents[3]
COMMANDS = Path(sys.executable).parent


def run_command(folder, *arguments, **environment):
    """Run a command in a folder, with the installed scripts and this source on the paths."""
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment["PATH"] = os.pathsep.join([str(COMMANDS), os.environ["PATH"]])
    return subprocess.run(
        arguments,
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def run_here(monkeypatch, folder, name, *arguments, code=0, **environment):
    """Run an installed command in this process, which has imported what it takes seconds to import; its result."""
    [command] = entry_points(group="console_scripts", name=name)
    with monkeypatch.context() as patch:
        patch.chdir(folder)
        done = CliRunner().invoke(command.load(), arguments, env=environment)
    assert done.exit_code == code, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    return done
