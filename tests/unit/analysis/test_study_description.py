"""What a study is, and what is refused."""

from pathlib import Path

import pytest
import yaml

from railctl.analysis.study import PlannedRun, StudyFolder, planned_runs, read_study
from railctl.common.strict import ConfigError

GIVEN = {"contenders": ["dqn", "ppo"], "levels": ["easy"], "seeds": "1..3", "episodes": 30, "judgement": {"block": 10}}


@pytest.fixture
def written(tmp_path: Path):
    def write(**changes: object) -> Path:
        path = tmp_path / "small.yaml"
        path.write_text(yaml.safe_dump(GIVEN | changes))
        return path

    return write


def test_short_forms_are_spelled_out(written):
    per = {"name": "per", "algorithm": "dqn", "settings": {"replay": "prioritized"}}
    study = read_study(written(contenders=["ppo", per, {"algorithm": "sil"}]))
    assert study.name == "small"  # of the file
    assert study.seeds == (1, 2, 3)
    assert [(one.name, one.algorithm) for one in study.contenders] == [("ppo", "ppo"), ("per", "dqn"), ("sil", "sil")]


def test_runs_come_seed_by_seed(written):
    runs = list(planned_runs(read_study(written(levels=["easy", "hard"]))))
    assert runs[:4] == [(name, level, 1) for level in ("easy", "hard") for name in ("dqn", "ppo")]
    assert len(runs) == len({run.name for run in runs}) == 12


def test_where_things_lie():
    folder, run = StudyFolder(Path("s")), PlannedRun("dqn+per", "hard", 7)
    assert folder.run(run) == Path("s/runs/dqn+per-hard-7")
    assert folder.evaluation(run) == Path("s/evaluations/dqn+per-hard-7.json")
    assert folder.reference("planner", "easy") == Path("s/references/planner-easy.json")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"level": ["easy"]}, "unknown key level: did you mean levels? known are contenders, episodes, evaluation,"),
        (
            {"contenders": [{"name": "a", "algoritm": "dqn"}]},
            "unknown key contenders.0.algoritm: did you mean algorithm? known are algorithm, name, settings",
        ),
        ({"judgement": {"blocks": 3}}, "unknown key judgement.blocks: did you mean block?"),
        ({"contenders": []}, "contenders: input should be a list of at least 1 item, not []"),
        ({"contenders": ["dqn", "dqn"]}, "contenders: dqn is there 2 times: give each a name of its own"),
        ({"contenders": ["d q n"]}, "contenders.0.name: string should match pattern"),
        ({"seeds": [1, 2, 1]}, "seeds: 1 is there 2 times: leave the others out"),
        ({"seeds": "5..1"}, "seeds: '5..1' is no span of at most 1000: write for example 1..10, or a list"),
        ({"seeds": "1..5000"}, "seeds: '1..5000' is no span of at most 1000: write for example 1..10, or a list"),
        (
            {"seeds": "\u0661..\u0663"},
            "seeds: '\u0661..\u0663' is no span of at most 1000: write for example 1..10, or a list",
        ),
        ({"seeds": [-1]}, "seeds.0: input should be greater than or equal to 0, not -1"),
        (
            {"levels": ["easy", "e zy"]},
            "levels.1: string should match pattern '^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$', not",
        ),
        ({"levels": []}, "levels: input should be a list of at least 1 item, not []"),
        ({"levels": [5]}, "levels.0: input should be a valid string, not 5"),
        ({"levels": ["easy", "easy"]}, "levels: easy is there 2 times: leave the others out"),
        ({"references": ["random", "random"]}, "references: random is there 2 times: leave the others out"),
        (
            {"contenders": ["x", "x-a"], "levels": ["a-b", "b"]},
            "contenders: x on a-b and x-a on b would both be x-a-b: give one another name",
        ),
        (
            {"references": ["planner", "planner-replanned"], "levels": ["x", "replanned-x"]},
            (
                "references: planner on replanned-x and planner-replanned on x would both be planner-replanned-x: "
                "give a level another name"
            ),
        ),
        ({"episodes": 35}, "episodes 35 is not a multiple of judgement.block 10: make one fit the other"),
        (
            {"episodes": 20},
            (
                "episodes 20 are 2 blocks of judgement.block 10, fewer than judgement.zones 3: "
                "train longer, or make one of them smaller"
            ),
        ),
        ({"evaluation": {"episodes": 1001}}, "evaluation.episodes: input should be less than or equal to 1000"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(written, changes, text):
    path = written(**changes)
    with pytest.raises(ConfigError) as caught:
        read_study(path)
    assert str(caught.value).startswith(f"{path}: {text}")
    assert "\n" not in str(caught.value)


def test_a_file_that_holds_no_study(tmp_path: Path):
    path = tmp_path / "bad.yaml"
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        read_study(path)
    path.write_text("- a\n- b")
    with pytest.raises(ConfigError, match="holds no keys"):
        read_study(path)
    path.write_text("a: [")
    with pytest.raises(ConfigError, match="is not YAML"):
        read_study(path)
