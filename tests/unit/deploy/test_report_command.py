"""railctl report --curves, from the command line to the table."""

import json
from functools import partial
from pathlib import Path

import command_line
import numpy as np
import pytest

from railctl.deploy.commands import report as command


@pytest.fixture
def curves(tmp_path, monkeypatch):
    """Two algorithms: one jumps about, the other does not."""
    monkeypatch.chdir(tmp_path)
    jumps = -0.5 + 0.4 * (-1.0) ** np.arange(12)
    returns = np.stack([np.tile(jumps, (1, 5, 1)), np.tile(np.linspace(-0.9, -0.1, 12), (1, 5, 1))])
    np.savez("curves.npz", returns=returns, block=4, n_zones=1, algorithms=["wild", "calm"], levels=["easy"])


railctl = partial(command_line.railctl, "report")


def complaint(code, *arguments):
    return command_line.complaint(code, "report", *arguments)


def test_one_document_for_programs(curves):
    result = railctl("--curves", "curves.npz", "--json", "--random-protocol", "tool", "--switch", "zone_collapse=mean")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert (document["algorithms"], document["levels"], document["protocol"]) == (["wild", "calm"], ["easy"], "tool")
    assert len(document["metrics"]) == 20
    assert document["metrics"]["DT"]["switches"]["zone_collapse"] == "mean"
    assert document["metrics"]["DT"]["stats"]["all"]["zone0"]["bar_height"] == [1.4, 2.4]  # 3 - 8 / 5, 3 - 3 / 5
    assert {row["metric"] for row in document["sensitivity"]} == {"DT", "DR", "SRT", "LRT"}
    assert "metrics: 20 of 20" in result.stderr


@pytest.mark.usefixtures("tasks_here")
def test_a_table_for_people(curves):
    lines = railctl("--curves", "curves.npz").stdout.splitlines()
    assert lines[0] == "curves.npz: 2 algorithms x 1 levels x 5 runs x 12 episodes"
    at = lines.index(next(line for line in lines if line.startswith("DT, ")))
    assert [line.split() for line in lines[at + 1 : at + 4]] == [
        ["episodes", "#", "algorithm", "score", "low", "high", "differs", "from"],
        ["1-12", "1", "wild", "1.40", "1.40", "1.40", "2", "(2)"],
        ["2", "calm", "2.40", "2.40", "2.40", "1", "(1)"],
    ]
    assert lines[at + 4] == "the order at the defaults changes with no switch"


@pytest.mark.usefixtures("tasks_here")
def test_ranks_that_are_undefined_say_so(curves):
    document = json.loads(railctl("--curves", "curves.npz", "--json", "--random-protocol", "tool").stdout)
    document["metrics"]["DT"]["stats"]["all"]["zone0"] = {
        "eval_idx": [0, 1, 2],
        "note": "",
        "mean_rank": ["nan", "nan"],
    }
    document["metrics"]["DR"]["stats"]["all"]["zone0"]["ci95"][0] = ["nan", "nan"]
    _, table, _, _, other, *_ = command.judged_parts(document)
    first = [next(iter(column.cells)) for column in table.columns]
    assert first[3:] == ["-", "-", "-", "undefined: values are not finite"]
    assert [next(iter(column.cells)) for column in other.columns][4:6] == ["-", "-"]


@pytest.mark.usefixtures("tasks_here")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["no.npz"], "--curves no.npz: no such file"),
        (["curves.npz", "--random-protocol", "tol"], "--random-protocol 'tol': did you mean tool?"),
        (["curves.npz", "--switch", "zone=tool"], "unknown switch zone: did you mean zones?"),
        (["curves.npz", "--switch", "zones"], "switch zones: input should be 'index' or 'tool', not ''"),
    ],
)
def test_wrong_usage_is_one_line(curves, arguments, text):
    assert complaint(2, "--curves", *arguments).startswith(f"railctl: {text}")


@pytest.mark.usefixtures("tasks_here")
def test_a_file_that_cannot_be_used_is_one_line(curves):
    with np.load("curves.npz") as file:
        arrays = dict(file)
    arrays["returns"][1, 0, 3, 7:] = np.nan
    np.savez("short.npz", **arrays)
    assert complaint(1, "--curves", "short.npz") == (
        "railctl: short.npz: returns[1, 0, 3, 7] (algorithm, level, run, episode) is nan: "
        "every run needs a return for every episode"
    )
    Path("text.npz").write_text("curves")
    assert complaint(1, "--curves", "text.npz").startswith("railctl: text.npz is no readable .npz file")
