"""Which runs the benchmark of clusters makes."""

import argparse

import pytest

from railctl.common.task import WRONG_USAGE
from railctl.tools.bench.cluster import KINDS, cases_of, lag_of, main, up_to
from railctl.tools.bench.launching import Case


@pytest.mark.parametrize(
    ("lags", "actors", "machines", "kinds"),
    [
        (None, None, None, KINDS),
        (["free"], None, None, [("free", 2)]),
        (None, [1], None, [("0", 1), ("3", 1), ("free", 1)]),
        (["3", "free"], [1, 2], None, [("3", 1), ("3", 2), ("free", 1), ("free", 2)]),
        (["3"], [4], [0, 2], [("3", 4, 0), ("3", 4, 2)]),
        (None, None, [2], [("0", 2, 2), ("3", 2, 2), ("free", 2, 2)]),
    ],
)
def test_all_that_is_given_is_run_with_each_other(lags, actors, machines, kinds):
    cases = cases_of(["ppo", "sil"], "easy", lags, actors, machines)
    assert cases == [Case(name, "easy", *kind) for name in ("ppo", "sil") for kind in kinds]


def test_actors_are_shared_out_evenly():
    case = Case("ppo", "easy", "3", 8, 3)
    assert [case.actors_of(machine) for machine in range(3)] == [3, 3, 2]
    assert case.name == "ppo easy lag 3, actors 8 on 3 machines"
    assert Case("ppo", "easy", "3", 8, 1).name == "ppo easy lag 3, actors 8 on 1 machine"


def test_a_machine_without_an_actor_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["bench", "--machines", "3"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == WRONG_USAGE
    assert capsys.readouterr().err == "railctl: --actors 2: 3 machines need an actor each: use more\n"


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("--lag", "x", "--lag: 'x' is no lag: give a whole number from 0 to 1024, or free"),
        ("--level", "esy", "--level: unknown 'esy': did you mean easy? known are easy, hard, medium"),
    ],
)
def test_what_is_no_value_of_an_option_is_refused_in_a_line(monkeypatch, capsys, option, value, text):
    monkeypatch.setattr("sys.argv", ["bench", option, value])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == f"railctl: {text}\n"


@pytest.mark.parametrize("text", ["3.5", "-1", "1025", "fre", ""])
def test_what_is_no_lag_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="is no lag: give a whole number from 0 to 1024, or free"):
        lag_of(text)


@pytest.mark.parametrize("text", ["-1", "257", "two"])
def test_what_is_no_number_of_actors_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="is not a number from 0 to 256"):
        up_to(256)(text)
