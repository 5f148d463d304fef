"""What tests of the command line have at hand."""

import contextlib
import importlib
import io
import json
import logging
import sys

import pytest

from railctl.common.strict import ConfigError
from railctl.common.task import WRONG_USAGE
from railctl.deploy import levels, task
from railctl.deploy.commands import report


@pytest.fixture
def tasks_here(monkeypatch):
    """Tasks work in this process, which has imported what they need: a process of its own costs each a second."""
    for module in (levels, report):
        monkeypatch.setattr(module, "run_task", _run_here)


def _run_here(name, *arguments):
    """As `deploy.task.run_task`, whose own tests start processes."""
    out, complaints, code, level = io.StringIO(), io.StringIO(), 0, logging.root.level
    module = importlib.import_module(name)
    if hasattr(module, "__path__"):
        module = importlib.import_module(f"{name}.__main__")
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(complaints),
    ):
        patch.setattr(sys, "argv", [name, *arguments])
        patch.setattr(logging.root, "handlers", [])  # those of pytest: a task's own process has none
        try:
            module.main()
        except SystemExit as end:
            code = end.code
        finally:
            logging.root.setLevel(level)
    if code:
        text = complaints.getvalue().splitlines()[-1]
        raise ConfigError(text) if code == WRONG_USAGE else task.Failed(text)
    result = {}
    with task._Shower() as shower:
        for line in out.getvalue().splitlines():
            document = json.loads(line)
            if "progress" in document:
                shower.show(**document["progress"])
            else:
                result = document
    return result
