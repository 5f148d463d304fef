"""From names to studies, their folders and the configurations of their runs."""

import pytest
import yaml

from railctl.analysis.study import PlannedRun, Study, StudyFolder, planned_runs, read_study
from railctl.common.strict import ConfigError, flat
from railctl.deploy.runs import runs_root
from railctl.deploy.study.described import configurations, find_folder, find_study, named, save_study, shipped_studies

SMALL = {
    "name": "small",
    "contenders": ["dddqn", {"name": "per", "algorithm": "dddqn", "settings": {"replay": "prioritized"}}],
    "levels": ["easy", "hard"],
    "seeds": [4, 5],
    "episodes": 30,
    "judgement": {"block": 10},
}


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("RAILCTL_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


def study(**changes):
    return Study.model_validate(SMALL | changes)


def refused(call, *arguments):
    with pytest.raises(ConfigError) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_thesis_is_its_protocol():
    thesis = find_study("thesis")
    runs = configurations(thesis, cores=2)
    assert len(runs) == 210
    assert {config.episodes for config in runs.values()} == {1500}
    assert {config.algorithm for config in runs.values()} == {"dqn", "ddqn", "dddqn", "ppo", "ppor", "sil"}
    assert runs[PlannedRun("sil", "hard", 10)].learning.replay.capacity == 40000  # table 5.3
    assert runs[PlannedRun("ddqn", "medium", 3)].learning.dqn.learn_every_steps == 40
    assert (thesis.evaluation.episodes, thesis.judgement.block, thesis.judgement.zones) == (1000, 100, 3)


def test_the_letter_of_the_study_differs_from_ours_where_it_says():
    literal, ours = (configurations(find_study(name), cores=2) for name in ("thesis-literal", "thesis"))
    differ = {}
    for contender in ("dqn", "ddqn", "dddqn", "ppo", "ppor", "sil"):
        run = PlannedRun(contender, "hard", 1)
        theirs, own = (flat(runs[run].science) for runs in (literal, ours))
        differ[contender] = {key: theirs[key] for key in theirs if theirs[key] != own.get(key)}
    world = {"decisions": "legacy", "observation.features": "plain"}
    target = {"dqn.target_every": "episode", "dqn.target_tau": 0.01}
    policy = {"ppo.returns": "standardised", "ppo.advantages": "plain"}
    assert differ["dqn"] == world | {"dqn.transitions": "step"}
    assert differ["ddqn"] == differ["dqn"] | target
    assert differ["dddqn"] == differ["ddqn"] | {"network.kind": "dueling-apart"}
    assert differ["ppo"] == differ["ppor"] == world | policy
    assert differ["sil"] == differ["ppo"] | {"sil.returns": "bootstrapped", "replay.alpha_end": 0.0}


@pytest.mark.parametrize("name", shipped_studies())
def test_every_shipped_study_is_one(name):
    found = find_study(name)
    assert found.name == name
    assert list(configurations(found, cores=2)) == list(planned_runs(found))


def test_settings_of_all_runs_lie_below_those_of_a_contender():
    given = study(settings={"replay": {"capacity": 777}, "lag": 1}, contenders=[*SMALL["contenders"], "dqn"])
    per, plain = (configurations(given, 1)[PlannedRun(name, "hard", 5)] for name in ("per", "dqn"))
    assert (per.learning.replay.kind, per.learning.replay.capacity, per.lag, per.seed) == ("prioritized", 777, 1, 5)
    assert (plain.learning.replay.kind, plain.learning.replay.capacity, plain.algorithm) == ("uniform", 777, "dqn")
    assert list(per.mix) == ["hard"]
    assert (per.cluster.cores, per.cluster.actors) == (1, {"hard": 1})


def test_a_study_may_be_of_runs_that_are_free():
    config = configurations(study(settings={"lag": "free"}), 1)[PlannedRun("per", "hard", 5)]
    assert (config.lag, config.max_staleness, config.learning.steps_a_fragment) == ("free", 32, None)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"contenders": ["dqnn"]}, "contender dqnn on easy: unknown algorithm 'dqnn': did you mean dqn?"),
        (
            {"contenders": ["dqn", {"name": "x", "algorithm": "ppo", "settings": {"dqn": {"batch_size": 3}}}]},
            "contender x on easy: dqn: rule ppo has no use for it, leave it out",
        ),
        (
            {"settings": {"dqn": {"batchsize": 3}}},
            "contender dddqn on easy: unknown key dqn.batchsize: did you mean batch_size?",
        ),
        ({"settings": {"episodes": 3}}, "settings.episodes: the study says it for all its runs, leave it out"),
        (
            {"settings": {"start_from": "some.safetensors"}},
            "settings.start_from some.safetensors: a study runs from anywhere, give the whole path",
        ),
        (
            {"contenders": [{"name": "x", "algorithm": "ppo", "settings": {"seed": 3}}]},
            "contenders.x.settings.seed: the study says it for all its runs, leave it out",
        ),
        (
            {"settings": {"cluster": {"cores": 1}}},
            "settings.cluster.cores: runs are packed onto the cores together, leave it out",
        ),
        (
            {"contenders": [{"name": "x", "algorithm": "ppo", "settings": {"cluster": {"listen": "tls/0.0.0.0:1"}}}]},
            "contenders.x.settings.cluster.listen: runs go on beside each other, and would listen at one address",
        ),
        (
            {"settings": {"cluster": {"keys": "x"}}},
            "settings.cluster.keys: runs go on beside each other, and none of them listens for other machines, leave",
        ),
    ],
)
def test_settings_that_make_no_run_are_refused(changes, text):
    assert refused(configurations, study(**changes), 2).startswith(text)


RUSH = {"rules": "stock", "size": [30, 40], "trains": 20, "cities": 4}


def test_a_study_may_have_levels_of_its_own():
    given = study(settings={"levels": {"rush": RUSH}}, levels=["easy", "rush"], evaluation={"episodes": 100})
    configs = configurations(given, 1)
    assert {run.level: list(config.world.levels) for run, config in configs.items()} == {
        "easy": ["easy"],
        "rush": ["rush"],
    }
    rush = configs[PlannedRun("dddqn", "rush", 4)]
    assert (rush.world.bounds, rush.cluster.actors) == ((30, 40, 20), {"rush": 0})
    folder = StudyFolder(runs_root() / "small")
    save_study(folder, given)
    assert configurations(read_study(folder.study_file), 1) == configs
    other = study(
        settings={"levels": {"rush": RUSH | {"trains": 3}}}, levels=["easy", "rush"], evaluation={"episodes": 100}
    )
    assert "was started with settings.levels.rush.trains 20, not 3" in refused(save_study, folder, other)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"levels": ["easy", "eazy"]}, "contender dddqn on eazy: unknown level 'eazy': did you mean easy?"),
        (
            {"levels": ["rush"], "settings": {"levels": {"rush": RUSH}}},
            "evaluation.episodes 1000: rush keeps only 100 from training, use no more",
        ),
        (
            {
                "levels": ["rush"],
                "settings": {"levels": {"rush": RUSH | {"speeds": {0.5: 1}}}},
                "evaluation": {"episodes": 100},
                "references": ["planner"],
            },
            "references: planner plans for trains of speed 1 that never break down, unlike rush's: leave it out",
        ),
        (
            {"settings": {"levels": {"rush": RUSH | {"trains": 0}}}},
            "contender dddqn on easy: levels.rush.trains: input should be greater than or equal to 1, not 0",
        ),
        (
            {"settings": {"levels": {"easy": RUSH}}},
            "contender dddqn on easy: levels.easy: these levels ship with the project, give yours another name",
        ),
        (
            {"settings": {"levels": 5}},
            "contender dddqn on easy: levels: input should be a valid dictionary, not 5",
        ),
        (
            {"contenders": [{"name": "x", "algorithm": "ppo", "settings": {"levels": {"rush": RUSH}}}]},
            "contenders.x.settings.levels: all contenders have the same ones, give them under settings.levels",
        ),
    ],
)
def test_levels_that_no_study_can_have_are_refused(changes, text):
    assert refused(configurations, study(**changes), 2).startswith(text)


def test_a_started_study_is_found_by_its_name_and_stays_as_it_is():
    folder = StudyFolder(runs_root() / "small")
    save_study(folder, study())
    save_study(folder, study())
    assert find_folder("small").path == folder.path
    assert find_study("small") == study() == read_study(folder.study_file)
    assert refused(save_study, folder, study(episodes=60)) == (
        "study small was started with episodes 30, not 60: "
        f"give the changed one another --name, or delete {folder.path}"
    )
    changed = study(
        contenders=[{"name": "dddqn", "algorithm": "dddqn", "settings": {"lag": 1}}, SMALL["contenders"][1]]
    )
    assert "was started with contenders.dddqn.settings.lag None, not 1" in refused(save_study, folder, changed)
    turned = study(contenders=SMALL["contenders"][::-1])
    assert "was started with order of contenders ['dddqn', 'per'], not ['per', 'dddqn']" in refused(
        save_study, folder, turned
    )
    assert find_study("small") == study()


def test_a_file_is_found_by_what_it_says(tmp_path):
    path = tmp_path / "any.yaml"
    path.write_text(yaml.safe_dump(SMALL))
    assert find_study(str(path)) == study()
    assert refused(find_folder, str(path)) == (
        f"study small has not been started in {runs_root()}: start it with railctl study run {path}"
    )
    save_study(StudyFolder(runs_root() / "small"), study())
    assert find_folder(str(path)).path == runs_root() / "small"


def test_what_is_not_there_is_said():
    assert refused(find_study, "thesi").startswith("no study named 'thesi': did you mean thesis? known are dispatch, ")
    assert refused(find_study, "no.yaml").startswith("no.yaml cannot be read")
    assert refused(find_folder, "thesis").startswith("study thesis has not been started in")
    assert refused(named, study(), "a/b").startswith("--name 'a/b': use letters")


def test_a_run_is_no_study(root):
    (root / "small").mkdir(parents=True)
    (root / "small" / "config.yaml").touch()
    assert refused(save_study, StudyFolder(root / "small"), study()) == (
        f"{root / 'small'} is a run: give the study another --name"
    )
