"""What a run looks like: every figure that matters is in the text."""

import time
from collections import Counter

import pytest
from made_rows import episode_row
from rich.console import Console

from railctl.common.compile_signs import COMPILING
from railctl.common.records.control import ProcessStatus, Progress, Status
from railctl.common.records.rows import EvaluationRow
from railctl.deploy.show import (
    duration,
    evaluation_table,
    number,
    process_table,
    progress_line,
    row_line,
    score_table,
    summary,
    view,
)


def rendered(renderable, width=120):
    console = Console(record=True, width=width, force_terminal=False, quiet=False, file=None)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get()


def episode(number_, value=-0.5, arrived=1, level="easy"):
    return episode_row(
        number_, level=level, normalised_return=value, arrived=arrived, steps=30 + number_, epsilon=0.125
    )


def evaluation(number_, value=-0.25, level="easy", all_arrived=0.5):
    return EvaluationRow(
        mode="greedy",
        episode=number_,
        level=level,
        levels=10,
        normalised_return=value,
        arrived_share=0.75,
        all_arrived_share=all_arrived,
        mean_steps=41.5,
        weights_digest="0" * 32,
        evaluated_unix_s=1000.0,
        evaluating_s=1.0,
    )


def process(name="learner", **changes):
    fields = {
        "process": name,
        "role": name.partition("-")[0],
        "serves": None,
        "pid": 4321,
        "state": "training",
        "restarts": 0,
        "last_heartbeat_unix_s": None,
    }
    return ProcessStatus(**fields | changes)


def status(staleness=None, **changes):
    progress = Progress(
        done=40,
        leased=2,
        waiting={"easy": 1, "hard": 2},
        weights_version=40,
        snapshot=30,
        evaluations=3,
        evaluations_due=4,
        return_last_100=-0.375,
        staleness_last_100=staleness,
        episodes_per_s=2.5,
        steps_per_s=99.6,
        refused=0,
        duplicates=0,
        reissued=0,
    )
    fields = {
        "run": "one",
        "path": "runs/one",
        "state": "running",
        "algorithm": "dddqn",
        "episodes": 100,
        "supervisor_pid": 1,
        "progress": progress,
        "time_left_s": 24.0,
        "problems": [],
        "processes": [process(), process("actor-easy-0", serves="easy", pid=None, state="waiting to restart")],
    }
    return Status(**fields | changes)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0:00"), (9.99, "0:09"), (60, "1:00"), (3599, "59:59"), (3600, "1:00:00"), (360_000, "100:00:00")],
)
def test_durations_are_read_like_a_clock(seconds, text):
    assert duration(seconds) == text


def test_a_number_may_be_none():
    assert (number(None), number(-0.12345)) == ("-", "-0.123")


def test_one_line_says_how_far_a_run_is():
    assert progress_line(status()) == (
        "running  40/100 episodes  return(100) -0.375  2.5 ep/s  3/4 evaluations  1 processes  0:24 left"
    )
    assert progress_line(status(time_left_s=None)).endswith("1 processes")
    assert progress_line(status(state="starting", progress=None)) == "starting ..."


@pytest.mark.parametrize(
    ("staleness", "in_line", "in_view"),
    [(None, "", ""), (0.0, "", ""), (2.34, "  staleness(100) 2.3", "staleness of the last 100: 2.3")],
)
def test_how_stale_weights_are_is_told_where_they_are(staleness, in_line, in_view):
    assert f"return(100) -0.375{in_line}  2.5 ep/s" in progress_line(status(staleness))
    seen = rendered(view(status(staleness), []))
    assert in_view in seen
    assert ("staleness" in seen) == bool(in_view)


def test_compiling_is_said_before_there_is_progress():
    compiles = [process("learner", state=COMPILING), process("actor-easy-0", state="waiting for work")]
    starting = status(state="starting", progress=None, processes=compiles)
    assert progress_line(starting) == "learner: compiling, the first time only ..."
    assert "learner: compiling, the first time only ..." in rendered(view(starting, []))


def test_the_live_view_says_it_all():
    text = rendered(view(status(problems=["first", "second", "third", "fourth"]), [evaluation(20), evaluation(40)]))
    text = " ".join(text.replace("│", " ").split())  # lines may be broken anywhere
    for part in (
        "railctl one",
        "Ctrl-C stops cleanly",
        "running",
        "40/100 episodes",
        "0:24 left",
        "return of the last 100: -0.375",
        "2.5 episodes/s",
        "100 steps/s",
        "2 leased",
        "3 waiting",
        "snapshot 30",
        "-0.250",
        "75%",
        "learner",
        "4321",
        "waiting to restart",
        "! second",
        "! fourth",
    ):
        assert part in text, part
    assert "! first" not in text  # only the newest problems


def test_the_live_view_of_a_run_that_starts():
    text = rendered(view(status(state="starting", progress=None, processes=[process("router")]), []))
    assert "starting" in text
    assert "router" in text
    assert "greedy" not in text


def test_the_live_view_shows_the_newest_evaluations():
    text = rendered(view(status(), [evaluation(1000 + number_) for number_ in range(20)]))
    assert "1019" in text
    assert "1012" in text
    assert "1011" not in text


def test_problems_are_shown_as_they_are():
    text = rendered(view(status(problems=["learner died: [/red] [Errno 28]"]), []))
    assert "! learner died: [/red] [Errno 28]" in text


def test_the_table_of_processes(monkeypatch):
    monkeypatch.setattr(time, "time", lambda: 1010.4)
    shown = [
        process("router", state="running", last_heartbeat_unix_s=1008.0),
        process("actor-hard-3", serves="hard", pid=None, restarts=7, last_heartbeat_unix_s=2000.0),
        process("evaluator"),
    ]
    lines = [line.split() for line in rendered(process_table(status(processes=shown))).splitlines()]
    assert lines[1] == ["router", "4321", "running", "0", "2", "s", "ago"]
    assert lines[2] == ["actor-hard-3", "hard", "-", "training", "7", "0", "s", "ago"]  # a clock that went back
    assert lines[3] == ["evaluator", "4321", "training", "0", "-"]


def test_the_table_of_evaluations():
    [_, line] = rendered(evaluation_table([evaluation(50, all_arrived=0.125)])).splitlines()
    assert line.split() == ["50", "easy", "-0.250", "75%", "12%", "42"]


def test_the_summary_sets_blocks_of_episodes_beside_the_evaluation_at_their_end():
    episodes = [episode(n, value=-1 + n / 64, arrived=n % 3) for n in range(40)]
    evaluations = [evaluation(n, value=-n / 100) for n in (10, 20, 30, 40)]
    lines = [line for line in rendered(summary(episodes, evaluations)).splitlines() if "-" in line and "│" in line]
    cells = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines]
    assert [row[0] for row in cells] == [f"{first}-{first + 3}" for first in range(1, 41, 4)]
    assert cells[0] == ["1-4", "-0.977", "38%", "32", "", ""]
    assert cells[2][4:] == ["-0.100", "50%"]  # the evaluation after 10 episodes, in the block 9-12
    assert [row[4] for row in cells] == ["", "", "-0.100", "", "-0.200", "", "", "-0.300", "", "-0.400"]


def test_the_summary_of_a_short_run_has_a_line_an_episode():
    text = rendered(summary([episode(0), episode(1)], []))
    assert "1-1" in text
    assert "2-2" in text


def test_the_summary_of_a_mix_shows_all_its_levels():
    episodes = [episode(0, level="easy"), episode(1, level="hard")]
    text = rendered(summary(episodes, [evaluation(2, -0.125, "easy"), evaluation(2, -0.875, "hard")]))
    assert "-0.125" in text
    assert "-0.875" in text


LONG = "ABCDEFGHIJKLMNOPQRSTUVWXYZABCDEFGHIJKLMN"  # as long as names of levels may be
SCORES = ("mean", "low", "high", "median", "std", "arrived_share", "all_arrived_share")
TABLES = {  # and how often the name is there
    "evaluations": (evaluation_table([evaluation(50, level=LONG)]), 1),
    "scores": (
        score_table([dict.fromkeys(SCORES, -0.5) | {"level": LONG, "levels": 1000, "mean_steps": 99.0, "score": None}]),
        1,
    ),
    "processes": (process_table(status(processes=[process(f"actor-{LONG}-255", serves=LONG)])), 2),
    "summary": (summary([episode(0)], [evaluation(1, -0.5, LONG), evaluation(1, -0.5, "hard")]), 2),
}


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("table", TABLES)
def test_no_table_cuts_a_long_name(table, width):
    shown, times = TABLES[table]
    text = rendered(shown, width).replace("Summary", "summary")
    assert Counter(filter(str.isupper, text)) == Counter(LONG * times)
    assert "\N{HORIZONTAL ELLIPSIS}" not in text


def test_a_line_has_a_long_name_whole():
    assert row_line(episode(7, level=LONG)).startswith(f"episode      7  {LONG}  return  -0.500  ")
    assert row_line(evaluation(50, level=LONG)).startswith(f"checkpoint  50  {LONG}  greedy  -0.250  ")


def test_a_row_is_a_line_of_its_figures():
    assert row_line(episode(7)) == (
        "episode      7  easy    return  -0.500  arrived 1/2  steps  37  epsilon 0.125  actor-easy-0"
    )
    assert row_line(episode(7).model_copy(update={"staleness": 2})) == f"{row_line(episode(7))}  staleness 2"
    assert row_line(episode(7).model_copy(update={"staleness": 0})) == row_line(episode(7))
    assert "epsilon" not in row_line(episode(7).model_copy(update={"epsilon": 0.0}))  # a policy's
    assert row_line(evaluation(50)) == (
        "checkpoint  50  easy    greedy  -0.250  arrived 75%  all arrived 50%  steps 42"
    )


@pytest.mark.parametrize("width", [70, 80, 100])
def test_lines_fit_a_terminal_and_keep_names_as_long_as_they_can(width):
    lines = [row_line(episode(7), width), row_line(evaluation(50), width), progress_line(status(), width)]
    assert max(map(len, lines)) <= width
    assert ("actor-easy-0" in lines[0], "epsilon" in lines[0]) == (width >= 80, width >= 100)
    assert "2.5 ep/s" in lines[2]


def test_names_are_not_cut_even_if_there_is_no_room():
    assert LONG in row_line(episode(7, level=LONG), 40)


def test_nothing_of_the_live_view_breaks_within_words_at_80_columns():
    lines = rendered(view(status(), [evaluation(50)]), 80).splitlines()
    assert max(map(len, lines)) <= 80
    for words in ("return of the last 100: -0.375", "2 leased  3 waiting", "last heartbeat", "waiting to restart"):
        assert any(words in line for line in lines), words
