"""What is read from disk, and what is refused in a line."""

import json
from pathlib import Path

import made_study
import numpy as np
import pytest
import yaml

from railctl.analysis.report.loading import DamagedEvaluation, level_labels, load_runs, load_study
from railctl.analysis.report.results import Rectangle
from railctl.analysis.report.sections.settings import settings
from railctl.analysis.study import PlannedRun
from railctl.common.config import parse_config
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError
from railctl.deploy.resolve import resolve

JUDGEMENT = {"block": 3, "zones": 2}
HALF, WHOLE = np.linspace(-1, -0.5, 4), np.linspace(-1, -0.25, 6)


def has_score(trained):
    return trained.scored is not None


@pytest.fixture
def unfinished(tmp_path):
    """A study of which seed 1 is there, seed 2 half, and seed 3 not at all."""
    folder, _ = made_study.write_study(
        tmp_path / "s",
        name="s",
        contenders=[{"name": "dqn", "algorithm": "dqn"}, {"name": "ppo", "algorithm": "ppo"}],
        levels=["easy"],
        seeds=[1, 2, 3],
        episodes=6,
        references=["random"],
        judgement=JUDGEMENT,
    )
    for name in ("dqn", "ppo"):
        for seed, returns in ((1, WHOLE), (2, HALF)):
            run = PlannedRun(name, "easy", seed)
            made_study.make_run(folder.run(run), returns, algorithm=name, seed=seed, episodes=6, scored=-0.9)
    folder.evaluation(PlannedRun("dqn", "easy", 1)).write_text(made_study.evaluation("easy", [-0.2, -0.4]))
    return folder


def test_only_of_a_free_run_it_matters_how_stale_weights_were(tmp_path):
    for name, lag in (("free", "free"), ("three", 3)):
        made_study.make_run(tmp_path / name, WHOLE, algorithm="ppo", lag=lag)  # of staleness 0, 1, 2, 3, 0, 1
    found = {run.contender: trained for run, trained in load_runs([tmp_path / "free", tmp_path / "three"]).runs.items()}
    assert {name: (trained.is_free, trained.staleness) for name, trained in found.items()} == {
        "ppo lag=free max_staleness=32": (True, pytest.approx(7 / 6)),
        "ppo lag=3 max_staleness=null": (False, None),
    }


def test_a_study_is_as_far_as_its_folder_says(unfinished):
    (unfinished.run(PlannedRun("ppo", "easy", 2)) / "outcome.json").write_text(
        json.dumps({"outcome": "failed", "reason": "the learner died"})
    )
    results = load_study(unfinished)
    states = {run.name: (trained.state, trained.reason) for run, trained in results.runs.items()}
    assert states == {
        "dqn-easy-1": ("done", ""),
        "ppo-easy-1": ("done", ""),
        "dqn-easy-2": ("unfinished", ""),
        "ppo-easy-2": ("failed", "the learner died"),
        "dqn-easy-3": ("missing", ""),
        "ppo-easy-3": ("missing", ""),
    }
    done = results.runs[PlannedRun("dqn", "easy", 1)]
    assert done.returns.tolist() == WHOLE.tolist()
    assert done.unix_s == (made_study.BEGUN, made_study.BEGUN + 6)
    assert results.references == {("random", "easy"): None}


def test_a_studys_scores_are_its_final_evaluations_alone(unfinished):
    results = load_study(unfinished)
    dqn, ppo = (results.runs[PlannedRun(name, "easy", 1)].scored for name in ("dqn", "ppo"))
    assert (dqn.mean, dqn.levels, dqn.returns) == (pytest.approx(-0.3), 2, (-0.2, -0.4))
    assert ppo is None  # what it scored while it trained is another thing


def test_curves_and_scores_of_what_all_contenders_have(unfinished):
    results = load_study(unfinished)
    over = results.rectangle(results.is_whole)
    assert over == Rectangle(("easy",), (1,))
    assert results.returns(over).shape == (2, 1, 1, 6)
    assert results.block_means(results.runs[PlannedRun("dqn", "easy", 2)]).tolist() == [pytest.approx(HALF[:3].mean())]
    assert results.rectangle(has_score) is None
    unfinished.evaluation(PlannedRun("ppo", "easy", 1)).write_text(made_study.evaluation("easy", [-0.5]))
    results = load_study(unfinished)
    assert results.scores(results.rectangle(has_score)) == {"dqn": [[pytest.approx(-0.3)]], "ppo": [[-0.5]]}


def test_a_damaged_run_of_a_study_is_one_that_failed(unfinished):
    damaged, wrong = (unfinished.run(PlannedRun("dqn", "easy", seed)) for seed in (1, 2))
    (damaged / "episodes.jsonl").write_text("nonsense\n")
    (wrong / "config.yaml").write_text("episodes: -1\n")
    runs = load_study(unfinished).runs
    assert runs[PlannedRun("dqn", "easy", 1)].state == "failed"
    assert "line 1 is not a valid row" in runs[PlannedRun("dqn", "easy", 1)].reason
    assert runs[PlannedRun("dqn", "easy", 2)].reason.startswith(f"{wrong / 'config.yaml'}: ")


@pytest.mark.parametrize("text", ["", "{}", '{"rows": [{"level": "easy"}]}', made_study.evaluation("hard", [-1.0])])
def test_a_damaged_evaluation_is_named(unfinished, text):
    path = unfinished.evaluation(PlannedRun("dqn", "easy", 1))
    path.write_text(text)
    with pytest.raises(DamagedEvaluation, match=f"^{path} holds no score on easy: delete it and run the study again$"):
        load_study(unfinished)


def test_what_is_no_study_is_refused(tmp_path, unfinished):
    with pytest.raises(ConfigError, match=r"study.yaml cannot be read: No such file or directory: "):
        load_study(type(unfinished)(tmp_path))
    data = yaml.safe_load(unfinished.study_file.read_text())
    unfinished.study_file.write_text(yaml.safe_dump(data | {"judgement": {"blok": 3}}))
    with pytest.raises(ConfigError, match=r"study.yaml: unknown key judgement.blok: did you mean block\?"):
        load_study(unfinished)


def test_runs_are_compared_as_far_as_the_shortest_goes(tmp_path):
    paths = [
        made_study.make_run(tmp_path / name, np.full(length, -0.5), algorithm=name, scored=-0.4)
        for name, length in (("dqn", 61), ("sil", 50))
    ]
    results = load_runs(paths)
    assert (results.title, results.judgement.block, results.points, results.episodes) == ("dqn, sil", 3, 16, 48)
    long = load_runs([made_study.make_run(tmp_path / "long", np.full(350, -0.5))])
    assert (long.judgement.block, long.points, long.judgement.zones) == (100, 3, 3)
    assert results.runs[PlannedRun("sil", "easy", 1)].scored.mean == -0.4


def test_runs_are_told_apart_by_the_settings_in_which_they_differ(tmp_path):
    given = {
        "plain": {"algorithm": "dqn"},
        "other": {"algorithm": "dqn", "dqn": {"batch_size": 64}},
        "hard": {"algorithm": "dqn", "level": "hard", "seed": 2},
        "sil": {"algorithm": "sil", "level": "easy"},
        "sil-hard": {"algorithm": "sil", "level": "hard"},  # whose preset has other settings
    }
    paths = [made_study.make_run(tmp_path / name, WHOLE, **more) for name, more in given.items()]
    assert [run.contender for run in load_runs(paths).runs] == [
        "dqn dqn.batch_size=128",
        "dqn dqn.batch_size=64",
        "sil",
        "sil",
        "dqn",
    ]


RUSH = {"rules": "stock", "size": [20, 30], "trains": 9, "cities": 2}


def own(**changes):
    """A run of levels of its own, all called `rush`."""
    return {"level": "rush", "levels": {"rush": RUSH | changes}}


def test_levels_of_ones_own_are_levels(tmp_path):
    given = {"a": own(), "b": own() | {"algorithm": "ppo"}, "c": {"level": "easy"}}
    results = load_runs([made_study.make_run(tmp_path / name, WHOLE, **more) for name, more in given.items()])
    assert results.levels == ("easy", "rush")  # by trains
    assert [(run.contender, run.level) for run in results.runs] == [
        ("dddqn", "rush"),
        ("ppo", "rush"),
        ("dddqn", "easy"),
    ]


def test_different_levels_of_one_name_are_told_apart_and_not_compared(tmp_path):
    given = {"a": own(), "b": own(trains=3), "c": own(speeds={0.5: 1}), "d": {"level": "easy"}}
    results = load_runs([made_study.make_run(tmp_path / name, WHOLE, **more) for name, more in given.items()])
    apart = (
        "rush trains=9 speeds.0.5=null",
        "rush trains=3 speeds.0.5=null",
        "rush trains=9 speeds.0.5=1.0",
    )
    assert [(run.contender, run.level) for run in results.runs] == [("dddqn", level) for level in (*apart, "easy")]
    assert set(results.levels) == {*apart, "easy"}
    assert results.levels[0] in {"easy", apart[1]}  # by trains
    table = next(part for part in settings(results).parts if getattr(part, "name", "") == "table-levels")
    assert [row[:4] for row in table.rows] == [
        ["easy", "legacy", "25x25", "3"],
        ["rush", "stock", "20x30", "3"],
        ["rush", "stock", "20x30", "9"],
        ["rush", "stock", "20x30", "9"],
    ]
    assert [row[4].endswith("timetable true, speeds.0.5 1.0") for row in table.rows[2:]] == [True, False]


def test_files_of_the_same_name_that_hold_something_else_are_told_apart():
    found = {"size": [9, 9], "trains": 2, "training": 8, "evaluation": 2}
    configs = {}
    for number, digest in enumerate("aab"):
        levels = {"mine": {"files": "mine.pkl", "found": found | {"digest": digest * 16}}}
        plain = resolve({"level": "easy"}).plain() | {"levels": levels, "mix": {"mine": 1.0}}
        plain |= {"cluster": {"actors": {"mine": 1}}, "evaluation": {"levels": 2}}
        configs[Path(str(number))] = parse_config(plain)
    assert [*level_labels(configs).values()] == [
        f"mine digest={'a' * 16}",
        f"mine digest={'a' * 16}",
        f"mine digest={'b' * 16}",
    ]
    assert set(level_labels({path: configs[path] for path in (Path("0"), Path("1"))}).values()) == {"mine"}


def test_a_mixed_run_has_a_curve_a_level(tmp_path):
    returns = np.array([-0.1, -0.9] * 4)
    path = made_study.make_run(tmp_path / "mixed", returns, mix={"easy": 0.5, "hard": 0.5})
    runs = load_runs([path]).runs
    assert {run.level: trained.returns.tolist() for run, trained in runs.items()} == {
        "easy": [-0.1] * 4,
        "hard": [-0.9] * 4,
    }


def test_the_same_cell_twice_is_refused(tmp_path):
    paths = [made_study.make_run(tmp_path / name, WHOLE, algorithm="ppo", seed=3) for name in ("a", "b")]
    text = f"^runs {paths[0]} and {paths[1]} are both ppo on easy with seed 3: leave one of them out$"
    with pytest.raises(ConfigError, match=text):
        load_runs(paths)


def test_a_run_without_episodes_or_with_damaged_ones_is_refused(tmp_path):
    path = made_study.make_run(tmp_path / "a", [], episodes=5)
    with pytest.raises(ConfigError, match=f"^run {path} has no trained episodes yet: leave it out$"):
        load_runs([path])
    (path / "episodes.jsonl").write_text("{}\n")
    with pytest.raises(DamagedRows, match="line 1 is not a valid row"):
        load_runs([path])
    with pytest.raises(ConfigError, match=r"config.yaml cannot be read: No such file"):
        load_runs([tmp_path / "none"])


def test_two_seeds_on_fewer_levels_are_preferred_to_one_on_more(tmp_path):
    cells = [("easy", 1), ("hard", 1), ("easy", 2)]
    paths = [made_study.make_run(tmp_path / f"{level}-{seed}", WHOLE, level=level, seed=seed) for level, seed in cells]
    results = load_runs(paths)
    assert results.rectangle(results.is_whole) == Rectangle(("easy",), (1, 2))
