"""Tables, sentences and figures: figures worked by hand, and what is left out with a reason."""

from dataclasses import replace

import numpy as np
import pytest

from railctl.analysis.report import published
from railctl.analysis.report.contents import contents
from railctl.analysis.report.figures.style import looks
from railctl.analysis.report.markdown import final_scores
from railctl.analysis.report.parts import Figure, Listing
from railctl.analysis.report.results import Rectangle, Results, Scored, Trained
from railctl.analysis.report.sections.beyond import beyond
from railctl.analysis.report.sections.final import final
from railctl.analysis.report.sections.reliability import about, rules, why_not
from railctl.analysis.report.sections.settings import ours, settings
from railctl.analysis.report.sections.summary import summary
from railctl.analysis.report.sections.training import training
from railctl.analysis.report.tables import Beside, Interval, Spread, Table
from railctl.analysis.study import Judgement, PlannedRun
from railctl.deploy.resolve import resolve


def results(runs, episodes=6, **given):
    """Results of these runs, by contender, level and seed."""
    planned = {PlannedRun(*run): trained for run, trained in runs.items()}
    contenders, levels, seeds = (tuple(dict.fromkeys(run[part] for run in planned)) for part in range(3))
    judgement = Judgement(block=3, zones=2)
    return Results("t", contenders, levels, seeds, episodes, judgement, planned, "networks", **given)


def trained(*returns, scored=None):
    return Trained(state="done", returns=np.array(returns, np.float64), scored=scored)


def scored(*returns, arrived=0.5):
    return trained(scored=Scored(len(returns), float(np.mean(returns)), arrived, 0.25, returns))


def only(section, kind):
    [part] = [part for part in section.parts if isinstance(part, kind)]
    return part


def test_rules_of_a_pair():
    stats = {"significant": {"textbook_by_0.05": [[0, 1], [0, 2]], "by_0.01": [[0, 2], [1, 2]], "raw_0.05": [[2, 3]]}}
    assert rules(stats) == {(0, 1): "textbook", (0, 2): "both", (1, 2): "tool"}


def test_training_curves_are_medians_of_the_runs_that_got_there():
    runs = {
        ("dqn", "easy", 1): trained(-1, -0.9, -0.8, -0.3, -0.2, -0.1),
        ("dqn", "easy", 2): trained(-0.5, -0.5, -0.5, -0.4),
        ("dqn", "easy", 3): trained(-0.7, -0.7, -0.7, -0.6, -0.6, -0.6),
        ("ppo", "easy", 1): trained(-1, -1),
    }
    figure = only(training(results(runs), looks(["dqn", "ppo"])), Figure)
    curve = figure.numbers["easy"]["dqn"]
    assert list(figure.numbers["easy"]) == ["dqn"]
    assert curve["runs"] == [3, 2]
    np.testing.assert_allclose(curve["median"], [-0.7, -0.4])
    np.testing.assert_allclose(curve["low"], [-0.89, -0.59])  # 2.5% of the way from the lowest to the next
    np.testing.assert_allclose(curve["high"], [-0.51, -0.21])


def test_before_the_first_evaluation_point_there_is_a_sentence():
    section = training(results({("dqn", "easy", 1): trained(-1, -1)}), looks(["dqn"]))
    assert section.parts == ("No run has trained a whole evaluation point of 3 episodes yet.",)


def test_the_final_table_beside_the_studys():
    runs = {
        ("ppo", "easy", 1): scored(-0.2, -0.4, arrived=0.5),
        ("ppo", "easy", 2): scored(-0.4, -0.6, arrived=1.0),
        ("own", "easy", 1): scored(-0.75),
        ("own", "easy", 2): Trained(),
    }
    references = {("planner", "easy"): Scored(2, -0.05, 1.0, 1.0, (-0.04, -0.06)), ("random", "easy"): None}
    section = final(results(runs, references=references))
    ppo, own, planner = only(section, Table).rows
    assert ppo[:3] == ["easy", "ppo", 2]
    assert ppo[3] == (pytest.approx(-0.4), pytest.approx(np.sqrt(0.02)))
    assert ppo[4:] == [Spread(-0.42, 0.88), pytest.approx(-0.4), 0.75, 0.25]
    assert own == ["easy", "own", 1, Spread(-0.75, None), None, -0.75, 0.5, 0.25]
    assert planner == ["easy", "planner", None, Spread(-0.05, None), None, -0.05, 1.0, 1.0]
    assert only(section, Table).shown()[0][3:5] == ["-0.400 ± 0.141", "-0.42 ± 0.88"]
    assert section.parts[1].startswith("The study's ± 0.88 for ppo on easy is a misprint")
    assert section.parts[-1] == "The best mean returns: ppo on easy (-0.400)."


def test_the_studys_misprint_cannot_be():
    means = np.array([-1.0] * 5 + [0.0] * 5)
    assert np.std(means, ddof=1) == pytest.approx(0.527, abs=1e-3)
    spreads = {
        (level, name): published.final(level, name).std
        for level in ("easy", "medium", "hard")
        for name in ("dqn", "ddqn", "dddqn", "ppo", "ppor", "sil")
    }
    assert [cell for cell, std in spreads.items() if std > 0.527] == [("easy", "ppo")]
    assert [cell for cell in spreads if published.misprints(*cell)] == [("easy", "ppo")]


@pytest.mark.parametrize("level", ["easy", "medium", "hard"])
@pytest.mark.parametrize("name", ["dqn", "ddqn", "dddqn", "ppo", "ppor", "sil"])
def test_the_presets_are_the_studys_hyperparameters(name, level):
    assert ours(resolve({"algorithm": name, "level": level})) == published.hyperparameters(level, name)


def test_what_differs_from_the_study_is_said():
    changed = resolve({"algorithm": "sil", "level": "hard", "sil": {"epochs": 2}, "replay": {"capacity": 500}})
    runs = {("sil", "hard", 1): replace(trained(-1), config=changed)}
    section = settings(results(runs))
    table = next(part for part in section.parts if isinstance(part, Table))
    assert table.rows[0][-2:] == [Beside("500", "40000"), Beside("10 + 2", "10 + 13")]
    [line] = only(section, Listing).lines
    assert line == "sil on hard: buffer 500 in place of 40000, epochs 10 + 2 in place of 10 + 13."


def test_other_settings_are_said_once_where_levels_agree():
    runs = {
        (name, level, 1): replace(trained(-1), config=resolve({"algorithm": name, "level": level, "lag": lag}))
        for name, level, lag in (("ppo", "easy", 0), ("ppo", "hard", 2), ("dqn", "easy", 0))
    }
    table = settings(results(runs)).parts[-1]
    cells = {row[0]: row[1:] for row in table.rows}
    assert cells["lag"] == ["easy 0, hard 2", "0"]
    assert cells["ppo.clip"] == ["0.2", None]
    assert cells["discount"] == ["0.99", "0.99"]
    assert not {"seed", "algorithm", "dqn.batch_size", "replay.capacity"} & set(cells)


def test_what_nobody_can_make_again_is_marked():
    free = resolve({"algorithm": "ppo", "level": "easy", "lag": "free", "max_staleness": 9})
    runs = {
        ("own", "easy", 1): replace(trained(*WHOLE), config=free, staleness=2.34),
        ("own", "easy", 2): replace(trained(*WHOLE), config=free),
        ("dqn", "easy", 1): replace(trained(*WHOLE), config=resolve({"algorithm": "dqn", "lag": 3})),
    }
    listed = [line for part in summary(results(runs)).parts if isinstance(part, Listing) for line in part.lines]
    assert [line for line in listed if "repeatable" in line] == [
        "own-easy-1 is not repeatable: acted with the newest weights (staleness mean 2.3, at most 9).",
        "own-easy-2 is not repeatable: acted with the newest weights (staleness mean -, at most 9).",
    ]
    table = final_scores(results(runs))
    assert "| `own` (lag free: not repeatable) |" in table
    assert "| `dqn` |" in table


def test_the_levels_are_described_once_each():
    rush = {
        "rules": "stock",
        "size": [20, 30],
        "trains": 9,
        "cities": 2,
        "malfunctions": {"rate": 0.1, "min_steps": 2, "max_steps": 3},
    }
    given = {"levels": {"rush": rush}, "mix": {"easy": 0.5, "rush": 0.5}}
    configs = {
        ("dqn", "easy", 1): resolve({"algorithm": "dqn"} | given),
        ("dqn", "rush", 1): resolve({"algorithm": "dqn"} | given),
        ("ppo", "easy", 1): resolve({"algorithm": "ppo"}),
    }
    runs = {run: replace(trained(-1), config=config) for run, config in configs.items()}
    [table] = [part for part in settings(results(runs)).parts if getattr(part, "name", "") == "table-levels"]
    assert table.shown() == [
        ["easy", "legacy", "25x25", "3", "cities 2, rails_between_cities 2, held_out 1000, rails_in_city 3"],
        [
            "rush",
            "stock",
            "20x30",
            "9",
            (
                "cities 2, rails_between_cities 2, held_out 100, rail_pairs_in_city 2, timetable true, "
                "malfunctions.rate 0.1, malfunctions.min_steps 2, malfunctions.max_steps 3"
            ),
        ],
    ]
    others = {row[0] for row in settings(results(runs)).parts[-1].rows}
    assert not {key for key in others if key.startswith("levels")}
    assert {"observation.kind", "reward.kind", "decisions"} <= others


WHOLE = [-1, -1, -1, -0.5, -0.5, -0.5]


def test_why_there_are_no_rankings():
    alone = results({("dqn", "easy", 1): trained(*WHOLE)})
    assert why_not(alone, alone.rectangle(alone.is_whole)).startswith("Rankings compare contenders, and here is only")
    one = {("dqn", "easy", 1): trained(*WHOLE), ("ppo", "easy", 1): trained(*WHOLE)}
    assert "here is one" in why_not(results(one), Rectangle(("easy",), (1,)))
    half = results(one | {("ppo", "easy", 1): trained(-1)})
    assert half.rectangle(half.is_whole) is None
    assert "there is none: none is there of ppo on easy. They are left out" in why_not(half, None)
    short = results(one, episodes=3)
    assert "need 2 evaluation points of 3 episodes" in why_not(short, Rectangle(("easy",), (1, 2)))
    assert why_not(results(one), Rectangle(("easy",), (1, 2))) is None


def test_a_study_of_one_zone_has_one_panel_a_level():
    rng = np.random.default_rng(1)
    cells = [(name, level, seed) for name in ("dqn", "ppo") for level in ("easy", "hard") for seed in (1, 2)]
    found = replace(
        results({cell: trained(*-rng.random(6)) for cell in cells}),
        judgement=Judgement(block=3, zones=1, bootstraps=10, permutations=10),
    )
    sections, _judged = contents(found, lambda _done: None)
    figures = {part.name: part for section in sections for part in section.parts if isinstance(part, Figure)}
    titles = {name: [axes.get_title(loc="left") for axes in figures[name].drawing.axes] for name in figures}
    assert titles["figure-5.3"] == titles["figure-5.5"] == ["Whole training"]
    assert titles["figure-appendix-1"] == titles["figure-appendix-3"] == ["easy", "hard"]


def test_what_is_compared_is_said():
    runs = {(name, "easy", seed): trained(*WHOLE) for name in ("dqn", "ppo") for seed in (1, 2, 3)}
    runs["ppo", "easy", 3] = trained(-1)
    found = results(runs)
    assert about(found, found.rectangle(found.is_whole)) == (
        "Compared are the runs that all contenders have: levels easy, seeds 1, 2 (n = 2 runs each). "
        "2 runs are not whole or stand alone, and are left out."
    )


def test_beyond_the_study_of_one_run_there_are_figures_without_intervals():
    found = results({("dqn", "easy", 1): replace(scored(-0.25), returns=np.array(WHOLE))})
    section = beyond(found, found.rectangle(found.is_whole), None, looks(["dqn"]))
    names = [part.name for part in section.parts if not isinstance(part, str)]
    assert names == ["figure-iqm", "table-aggregates", "figure-profiles", "figure-iqm-curves"]
    [row] = section.parts[2].rows
    assert [cell.value for cell in row[1:]] == [-0.25, -0.25, -0.25, pytest.approx(0.15)]
    assert all(np.isnan(cell.low) for cell in row[1:])
    assert "Of a single run nothing can be said" in section.parts[0]
    assert [part for part in section.parts if isinstance(part, str)][1:] == [
        "How probable each rank is cannot be said of one contender, or from one run: it is left out.",
        "A paired test needs two contenders and two seeds at least: it is left out.",
    ]


def test_pairs_within_seeds_are_worked_by_hand():
    runs = {("x", "easy", 1): scored(-0.2), ("y", "easy", 1): scored(-0.4)}
    runs |= {("x", "easy", 2): scored(-0.5), ("y", "easy", 2): scored(-0.6)}
    section = beyond(results(runs), None, None, looks("xy"))
    table = section.parts[-1]
    assert table.name == "table-paired"
    [(x, y, difference, p, corrected)] = table.rows
    assert (x, y, corrected) == ("x", "y", p)  # of one pair there is nothing to correct
    assert difference == Interval(*map(pytest.approx, (0.15, 0.1, 0.2)))
    assert p == 0.5  # 2 of the 4 ways to flip signs have a sum as far from 0


def test_switches_that_turn_the_order_are_marked():
    cases = [
        ("dt_detrend", True, [1.0, 2.0], False),
        ("dt_detrend", False, [2.0, 1.0], True),
        ("normalize", "x", ["nan", "nan"], None),
    ]
    keys = ("switch", "value", "mean_rank", "order_changed")
    rows = [{"metric": "DT", "zone": "zone0", **dict(zip(keys, case, strict=True))} for case in cases]
    runs = {(name, "easy", 1): trained() for name in "xy"}
    table = beyond(results(runs, episodes=0), None, rows, looks("xy")).parts[-1]
    assert table.shown() == [
        ["DT", "Zone 1", "dt_detrend", "true", "1.00", "2.00", "no"],
        ["DT", "Zone 1", "dt_detrend", "false", "2.00", "1.00", "yes"],
        ["DT", "Zone 1", "normalize", "x", "-", "-", "-"],
    ]


def test_the_summary_names_what_is_missing():
    runs = {
        ("dqn", "easy", 1): replace(trained(*WHOLE), unix_s=(10.0, 70.0), arithmetic=(("torch", "2"),)),
        ("dqn", "easy", 2): replace(trained(-1), state="unfinished", unix_s=(100.0, 3700.0)),
        ("dqn", "easy", 3): Trained(),
        ("dqn", "easy", 4): Trained(state="failed", reason="the disk is full"),
    }
    section = summary(results(runs, references={("random", "easy"): None}))
    lines = [line for part in section.parts if isinstance(part, Listing) for line in part.lines]
    assert lines[:-1] == [
        "Runs: 1 done, 1 unfinished, 1 failed, 1 missing.",
        "Unfinished: dqn-easy-2.",
        "Missing: dqn-easy-3.",
        "Failed: dqn-easy-4: the disk is full.",
        "Done, but without a final score: dqn-easy-1.",
        "Reference policies without a score: random on easy.",
        "Time: 1:01:30 from the first episode to the last; 1:01:00 if runs are added up.",
        "Computed with torch 2: 1 run.",
    ]
    assert lines[-1].startswith("This report: railctl ")
    assert only(section, Table).rows == [["easy", "dqn", 4, 1, 1, 1, 1, 7, 0]]
