"""A small study with all its figures and tables, drawn once for all tests."""

import json

import made_study
import pytest

from railctl.analysis.report.__main__ import parsed, report

JUDGEMENT = {"block": 5, "zones": 3, "bootstraps": 40, "permutations": 60}
QUALITIES = {"dddqn": 0.6, "ppo": 0.3, "dddqn-per": 0.45}


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """The folder of a whole study, reported on."""
    path = tmp_path_factory.mktemp("studies") / "made"
    folder = made_study.make_study(
        path, QUALITIES, levels=["easy", "hard"], seeds=[1, 2, 3], episodes=45, judgement=JUDGEMENT
    )
    report(parsed(["--study", str(path)]))
    return folder


@pytest.fixture(scope="session")
def numbers(made):
    """Its `report.json`."""
    return json.loads((made.report / "report.json").read_text())
