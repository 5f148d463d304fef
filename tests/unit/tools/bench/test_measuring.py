"""What all benchmarks share: medians, one document, one line for what is wrong."""

import json

import pytest

from railctl.tools.bench import measuring
from railctl.tools.bench.measuring import Comparison, DisagreementError, Row, Sample, measure, show, timed


def comparison(name, *numbers):
    """Gives the numbers (ours, theirs), a pair a repeat."""
    return Comparison(name, lambda repeat: [Sample(name, "us", *numbers[repeat])])


def test_rows_are_medians_without_the_first_repeat():
    [row] = measure([comparison("one", (999, 1), (1, 30), (2, 10), (3, 20))], repeats=3)
    assert row == Row("one", "us", ours=2, theirs=20, ratio=10, repeats=3)


def test_a_comparison_may_give_several_rows():
    both = Comparison("both", lambda _: [Sample("a", "us", 1, 2), Sample("b", "ms", 4, 2)])
    assert [(row.name, row.unit, row.ratio) for row in measure([both], repeats=2)] == [("a", "us", 2), ("b", "ms", 0.5)]


def test_of_rates_more_is_better():
    [row] = measure([Comparison("rate", lambda _: [Sample("a", "steps/s", 20, 2)])], repeats=1)
    assert row.ratio == 10


def test_progress_is_told_before_every_repeat_and_in_the_end():
    told = []
    measure([comparison("a", (1, 1), (1, 1)), comparison("b", (1, 1), (1, 1))], 1, lambda *said: told.append(said))
    assert told == [("a", 0, 4), ("a", 1, 4), ("b", 2, 4), ("b", 3, 4), ("done", 4, 4)]


def test_time_is_processor_time():
    seconds, result = timed(lambda: sum(range(100_000)))
    assert seconds > 0
    assert result == 4999950000


def test_json_is_one_document(capsys):
    show([Row("one", "us", 2, 20, 10, 3)], as_json=True)
    assert json.loads(capsys.readouterr().out) == {
        "rows": [{"name": "one", "unit": "us", "ours": 2, "theirs": 20, "ratio": 10, "repeats": 3}]
    }


def test_people_get_a_line_a_row(capsys):
    show([Row("one", "us", 2, 20, 10, 3), Row("another one", "ms", 0.25, 1, 4, 3)], as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [
        ["unit", "ours", "theirs", "ratio"],
        ["one", "us", "2", "20", "10x"],
        ["another", "one", "ms", "0.25", "1", "4x"],
        ["medians", "of", "3", "repeats"],
    ]


@pytest.fixture
def run(monkeypatch, capsys):
    monkeypatch.setattr("os.sched_setaffinity", lambda *_: None)
    monkeypatch.setattr("gc.freeze", lambda: None)

    def called(comparisons, *arguments, code=0):
        monkeypatch.setattr("sys.argv", ["bench", *arguments])
        if code:
            with pytest.raises(SystemExit) as ended:
                measuring.run("A test.", comparisons, worlds=3, fuel=("coal", "oil"))
            assert ended.value.code == code
        else:
            measuring.run("A test.", comparisons, worlds=3, fuel=("coal", "oil"))
        return capsys.readouterr()

    return called


def test_sizes_and_choices_are_options_with_defaults(run):
    def comparisons(worlds, fuel):
        print("what libraries say is no part of the document")  # noqa: T201
        return [comparison("one", *[(1, worlds * {"coal": 1, "oil": 2}[fuel])] * 3)]

    for arguments, ratio in (((), 3), (("--worlds", "7"), 7), (("--fuel", "oil"), 6)):
        [row] = json.loads(run(comparisons, "--json", "--repeats", "2", *arguments).out)["rows"]
        assert (row["ratio"], row["repeats"]) == (ratio, 2)


def test_progress_goes_to_stderr(run):
    said = run(lambda **_: [comparison("one", (1, 1), (1, 1))], "--repeats", "1")
    assert said.err.splitlines() == ["0 of 2 repeats: one", "2 of 2 repeats: done"]


def test_a_disagreement_is_one_line_and_no_times(run):
    def disagree(_repeat):
        raise DisagreementError("easy 3")

    said = run(lambda **_: [Comparison("one", disagree)], "--json", code=measuring.FAILED)
    assert said.out == ""
    assert said.err.splitlines()[-1] == "railctl: the two sides differ, so no times are given: easy 3"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--repeats", "0"), "railctl: --repeats: '0' is not a number above 0"),
        (("--worlds", "many"), "railctl: --worlds: 'many' is not a number above 0"),
        (("--fuel", "gas"), "railctl: --fuel: unknown 'gas': known are coal, oil"),
        (("--steps", "3"), "railctl: unrecognized arguments: --steps 3"),
    ],
)
def test_wrong_usage_is_one_line(run, arguments, line):
    said = run(lambda **_: [], *arguments, code=measuring.WRONG_USAGE)
    assert (said.out, said.err.splitlines()) == ("", [line])
