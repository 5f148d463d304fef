"""The examples in docstrings are true."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize(
    ("module", "examples"),
    [
        ("common.strict", 2),
        ("common.wire.keys", 2),
        ("common.wire.codec", 2),
        ("deploy.resolve", 2),
        ("deploy.plan", 1),
        ("deploy.show", 2),
        ("deploy.study.estimate", 1),
        ("deploy.study.levels", 1),
        ("deploy.commands.references", 2),
        ("deploy.output", 1),
        ("deploy.judged", 2),
    ],
)
def test_examples_in_docstrings_are_true(module, examples):
    failed, attempted = doctest.testmod(importlib.import_module(module))
    assert failed == 0
    assert attempted >= examples  # or the doctests were not found at all
