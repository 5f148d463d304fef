"""The examples in docstrings are true."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize(
    ("module", "examples"),
    [
        ("railctl.common.strict", 2),
        ("railctl.common.wire.keys", 2),
        ("railctl.common.wire.codec", 2),
        ("railctl.deploy.resolve", 2),
        ("railctl.deploy.plan", 1),
        ("railctl.deploy.show", 3),
        ("railctl.deploy.web.serving", 1),
        ("railctl.analysis.statistics", 2),
        ("railctl.deploy.web.thinning", 1),
        ("railctl.deploy.web.watched_study", 2),
        ("railctl.deploy.study.estimate", 1),
        ("railctl.deploy.study.levels", 1),
        ("railctl.deploy.commands.export", 1),
        ("railctl.deploy.commands.references", 2),
        ("railctl.deploy.output", 1),
        ("railctl.deploy.judged", 2),
        ("railctl.deploy.rendering", 2),
        ("railctl.common.pictures.canvas", 1),
        ("railctl.common.pictures.glyphs", 1),
    ],
)
def test_examples_in_docstrings_are_true(module, examples):
    failed, attempted = doctest.testmod(importlib.import_module(module))
    assert failed == 0
    assert attempted >= examples  # or the doctests were not found at all
