"""What the user says becomes a checked configuration: preset, file, options, `--set`; what is wrong is named."""

from pathlib import Path

import pytest
import yaml
from fuzzing import cases, fuzz
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.config import parse_config
from railctl.common.levels.distributions import shipped
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.strict import ConfigError, flat, section_of
from railctl.deploy.resolve import (
    algorithms,
    merge,
    parse_actors,
    parse_lag,
    parse_sets,
    read_file,
    resolve,
    resolve_existing,
    spelled_out,
)

RUSH = {"rules": "stock", "size": [30, 40], "trains": 20, "cities": 4}
SAVED = Path(__file__).parents[1] / "common" / "saved"  # configurations of an earlier version


def complaint(call, *arguments):
    with pytest.raises(ConfigError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


# New runs


@pytest.mark.parametrize("algorithm", algorithms())
@pytest.mark.parametrize("level", [*shipped()])
def test_every_preset_makes_a_run_of_every_level(algorithm, level):
    config = resolve({"algorithm": algorithm, "level": level})
    assert (config.algorithm, config.mix) == (algorithm, {level: 1.0})
    assert config.cluster.actors == {level: 0}


def test_nothing_given_is_the_default_run():
    config = resolve({})
    assert (config.algorithm, config.mix, config.episodes, config.seed) == ("dddqn", {"easy": 1.0}, 1500, 1)


def test_a_level_may_have_settings_of_its_own():
    assert resolve({"level": "easy"}).learning.dqn.learn_every_steps == 30
    assert resolve({"level": "medium"}).learning.dqn.learn_every_steps == 40
    assert resolve({"level": "hard"}).learning.dqn.learn_every_steps == 30


@pytest.mark.parametrize(
    ("mix", "steps"),
    [({"easy": 0.5, "medium": 0.5}, 40), ({"medium": 0.9, "hard": 0.1}, 30), ({"hard": 0.1, "easy": 0.9}, 30)],
)
def test_a_mix_has_the_settings_of_its_level_with_the_most_trains(mix, steps):
    assert resolve({"mix": mix}).learning.dqn.learn_every_steps == steps


def test_what_runs_in_parallel_has_an_actor_for_each_level():
    config = resolve({"mix": {"easy": 0.5, "hard": 0.5}, "lag": 1})
    assert config.cluster.actors == {"easy": 1, "hard": 1}


@pytest.mark.parametrize("algorithm", algorithms())
def test_every_algorithm_runs_free_with_whole_episodes_an_actor_and_a_bound(algorithm):
    config = resolve({"algorithm": algorithm, "lag": "free"})
    assert (config.max_staleness, config.cluster.actors, config.learning.steps_a_fragment) == (32, {"easy": 1}, None)
    assert resolve({"algorithm": algorithm, "lag": "free", "max_staleness": 5}).max_staleness == 5


def test_free_refuses_returns_that_it_cannot_correct():
    given_ = {"algorithm": "ppo", "lag": "free", "ppo": {"returns": "standardised"}}
    assert complaint(resolve, given_) == (
        "lag free: it corrects by values what older weights did, and those of ppo.returns standardised are on another "
        "scale than rewards, make it scaled"
    )


@pytest.mark.parametrize(
    ("text", "lag"), [("0", 0), ("3", 3), ("free", "free"), ("3.5", "3.5"), ("-1", "-1"), ("\u0663", "\u0663")]
)
def test_a_lag_of_the_command_line_is_a_number_if_it_looks_like_one(text, lag):
    assert parse_lag(text) == lag


def test_what_is_given_outranks_preset_and_level():
    config = resolve({"level": "medium", "discount": 0.5, "dqn": {"learn_every_steps": 7}})
    assert (config.learning.discount, config.learning.dqn.learn_every_steps) == (0.5, 7)
    assert config.learning.dqn.batch_size == resolve({}).learning.dqn.batch_size


def test_named_actors_replace_the_default_ones():
    assert resolve({"cluster": {"actors": {"any": 2}}}).cluster.actors == {"any": 2}
    assert resolve({"cluster": {"actors": {"easy": 0}}, "lag": 1}).cluster.actors == {"easy": 0}
    assert resolve({"cluster": {"cores": 1}, "lag": 1}).cluster.actors == {"easy": 1}


def test_resolving_changes_nothing_that_was_given():
    given_ = {"level": "hard", "cluster": {"cores": 1}}
    resolve(given_)
    assert given_ == {"level": "hard", "cluster": {"cores": 1}}


@pytest.mark.parametrize(
    ("given_", "text"),
    [
        ({"algorithm": "dddq"}, "unknown algorithm 'dddq': did you mean dddqn? known are dddqn"),
        ({"level": "esy"}, "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        ({"level": ["easy"]}, "level: input should be a name, not ['easy']"),
        ({"level": "easy", "mix": {"easy": 1}}, "level and mix are both given: leave one out"),
        ({"episods": 5}, "unknown key episods: did you mean episodes?"),
        ({"dqn": {"batchsize": 5}}, "unknown key dqn.batchsize: did you mean batch_size?"),
        ({"episodes": "many"}, "episodes: input should be a valid integer"),
        ({"mix": {"esy": 1}}, "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        ({"mix": {}}, "mix names no levels: write for example mix: {easy: 1}"),
        (
            {"mix": {"easy": "x"}},
            "mix.easy: input should be a valid number, unable to parse string as a number, not 'x'",
        ),
        ({"lag": "x"}, "lag: 'x' is no lag: give a whole number from 0 to 1024, or free"),
        ({"lag": 1, "fragment_steps": 3}, "lag 1 needs whole episodes: add --set fragment_steps=null"),
        ({"rule": None}, "rule: input should be a name, not None"),
        ({"rule": "x"}, "unknown rule 'x': known are dqn, drqn, imitate, ppo, ppor, sil"),
        ({"dqn": {"learning_rate": {"x": 1}}}, "dqn.learning_rate: input should be a valid number, not {'x': 1}"),
        ({"episodes": {}}, "episodes: input should be a valid integer, not {}"),
        ({"algorithm": None}, "algorithm: input should be a name, not None"),
        ({"network": {"hidden": 128}}, "network.hidden: input should be a list, not 128"),
        ({"dqn": {"target_tau": []}}, "dqn.target_tau: input should be a valid number, not []"),
        ({"mix": "easy"}, "mix: input should be a valid dictionary, not 'easy'"),
        ({"dqn": 5}, "dqn: input should be a valid dictionary, not 5"),
        ({"cluster": {"actors": {"hard": 1}}}, "no actors for level easy: add --actors easy=1"),
        ({"cluster": {"actors": None}}, "cluster.actors: input should be a valid dictionary, not None"),
        ({5: 1}, "5: keys should be strings, not 5"),
    ],
)
def test_what_is_wrong_is_named(given_, text):
    assert complaint(resolve, given_).startswith(text)


@pytest.mark.parametrize(
    ("given_", "text"),
    [
        ({"cluster": None}, "cluster: "),
        ({"cluster": 5}, "cluster: "),
        ({"mix": None}, "mix: "),
        ({"mix": 5}, "mix: "),
        ({"mix": [["easy"]]}, "mix: "),
    ],
)
def test_a_section_that_is_none_is_named(given_, text):
    assert complaint(resolve, given_).startswith(text)


# Runs that exist


def existing(**more):
    return resolve({"level": "easy", "episodes": 10} | more)


def test_an_existing_run_goes_on_as_it_was():
    assert resolve_existing(existing(), {}, "one") == existing()
    assert resolve_existing(existing(), {"level": "easy", "episodes": 10}, "one") == existing()


def test_an_existing_run_may_get_another_cluster():
    config = resolve_existing(existing(), {"cluster": {"actors": {"any": 3}, "cores": 1}}, "one")
    assert (config.cluster.actors, config.cluster.cores) == ({"any": 3}, 1)
    assert config.science == existing().science
    kept = resolve_existing(existing(cluster={"cores": 1}), {"cluster": {"actors": {"easy": 2}}}, "one")
    assert (kept.cluster.actors, kept.cluster.cores) == ({"easy": 2}, 1)


@pytest.mark.parametrize(
    ("given_", "was"),
    [
        ({"episodes": 20}, "episodes 10, not 20"),
        ({"seed": 5}, "seed 1, not 5"),
        ({"lag": 2}, "lag 0, not 2"),
        ({"lag": "free"}, "lag 0, not free"),
        ({"algorithm": "dqn"}, "algorithm dddqn, not dqn"),
        ({"algorithm": "ppo", "ppo": {"epochs": 3}}, "algorithm dddqn, not ppo"),
        ({"rule": "ppo"}, "rule dqn, not ppo"),
        ({"replay": "prioritized"}, "replay.kind uniform, not prioritized"),
        ({"observation": "global"}, "observation.kind tree, not global"),
        ({"observation": {"depth": 1}}, "observation.depth 2, not 1"),
        ({"reward": "delay"}, "reward.kind study, not delay"),
        ({"decisions": "always"}, "decisions cells, not always"),
        ({"fragment_steps": None}, "fragment_steps 30, not None"),
        ({"levels": {"easy": RUSH}}, "levels.easy.size [25, 25], not [30, 40]"),
        ({"dqn": {"batch_size": 5}}, "dqn.batch_size 150, not 5"),
        ({"network": {"hidden": [8]}}, "network.hidden [128, 128], not [8]"),
        ({"mix": {"easy": 0.5, "hard": 0.5}}, "level easy, not mix {'easy': 0.5, 'hard': 0.5}"),
        ({"level": "hard"}, "level easy, not level hard"),
        ({"level": "hard", "cluster": {"actors": {"any": 1}}}, "level easy, not level hard"),
        ({"level": "none"}, "level easy, not level none"),
        ({"mix": {"easy": 0.5}}, "level easy, not mix {'easy': 0.5}"),
    ],
)
def test_an_existing_run_is_not_made_another_one(given_, was):
    assert complaint(resolve_existing, existing(), given_, "one") == (
        f"run one exists with {was}: leave the option out to go on with it, or give another --name"
    )


def test_the_order_of_a_mix_makes_no_other_run():
    mixed = resolve({"mix": {"easy": 0.25, "hard": 0.75}})
    again = resolve_existing(mixed, {"mix": {"hard": 0.75, "easy": 0.25}}, "one")
    assert again.science == mixed.science


def test_what_is_wrong_for_an_existing_run_is_named_too():
    assert complaint(resolve_existing, existing(), {"dqn": {"batchsize": 1}}, "one").startswith("unknown key dqn.batch")
    assert complaint(resolve_existing, existing(), {"cluster": {"cores": 0}}, "one").startswith("cluster.cores: ")
    assert complaint(resolve_existing, existing(), {"cluster": {"actors": {"rush": 1}}}, "one") == (
        "no actors for level easy: add --actors easy=1"
    )
    assert complaint(resolve_existing, existing(), {"level": 5}, "one").startswith("level: input should be a name")
    assert complaint(resolve_existing, existing(), {"levels": [5]}, "one").startswith("levels: input should be a valid")


# Its parts


def test_a_level_is_short_for_a_mix():
    assert spelled_out({"level": "hard", "seed": 1}, "dqn") == {"mix": {"hard": 1.0}, "seed": 1}
    assert spelled_out({"mix": {"easy": 1}}, "dqn") == {"mix": {"easy": 1}}
    assert spelled_out({}, "dqn") == {}


def test_a_name_is_short_for_the_kind_of_a_section():
    assert spelled_out({"replay": "prioritized", "observation": "global", "network": "dueling"}, "dqn") == {
        "replay": {"kind": "prioritized"},
        "observation": {"kind": "global"},
        "network": {"kind": "dueling"},
    }
    given_ = {"decisions": "always", "algorithm": "dqn", "dqn": "fast", "replay": {"capacity": 3}, "nothing": "x"}
    assert spelled_out(given_, "dqn") == given_  # these have no kinds
    assert spelled_out({"replay": "prioritized"}, "ppo") == {"replay": "prioritized"}  # nor has ppo a replay


@pytest.mark.parametrize("said", ["true", "false", "reversed"])
def test_readings_of_the_study_are_chosen_by_settings_and_come_back_from_files(said):
    sets = parse_sets([f"dqn.double={said}", "dqn.target_every=episode", "network=dueling-apart"])
    config = resolve(sets | {"algorithm": "dddqn"})
    assert config.learning.dqn.double == yaml.safe_load(said)
    assert config.learning.dqn.share_an_episode == config.learning.dqn.target_tau
    assert config.learning.network.kind == "dueling-apart"
    assert parse_config(yaml.safe_load(yaml.safe_dump(config.plain()))) == config


def test_short_forms_make_runs():
    config = resolve({"algorithm": "dqn", "replay": "prioritized", "observation": "global", "reward": "delay"})
    assert (config.learning.replay.kind, config.learning.replay.capacity) == ("prioritized", 50000)
    assert (config.world.observation.kind, config.world.reward.kind) == ("global", "delay")
    assert config.world.observation == section_of(AnyObservation, "global")()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "No such file or directory: give an existing YAML file"),
        (b"", "holds no keys: write for example 'algorithm: dddqn'"),
        (b"- easy\n- hard", "holds no keys"),
        (b"easy", "holds no keys"),
        (b"a: [1\nb: {", "is not YAML: while parsing a flow "),
        (
            b"a: !!python/object:os.system {}",
            "is not YAML: a tag (tag:yaml.org,2002:python/object:os.system): leave it out",
        ),
        (b"\x00\x01", "is not YAML: "),
    ],
)
def test_a_run_file_that_is_none_is_named(tmp_path, content, text):
    path = tmp_path / "run.yaml"
    if content is not None:
        path.write_bytes(content)
    found = complaint(read_file, path)
    assert found.startswith(str(path))
    assert text in found


def test_a_folder_is_no_run_file(tmp_path):
    assert "Is a directory" in complaint(read_file, tmp_path)


@pytest.mark.parametrize("content", [b"\x89PNG\xff\xfe", b"seed: 0x_", b"seed: " + b"1" * 5000])
def test_a_run_file_that_is_no_text_or_holds_impossible_values_is_named(tmp_path, content):
    path = tmp_path / "run.yaml"
    path.write_bytes(content)
    assert complaint(read_file, path).startswith(str(path))


def test_a_run_file_is_plain_data(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("algorithm: dddqn\nmix: {easy: 0.5, hard: 0.5}\ndqn:\n  batch_size: 5\n")
    data = read_file(path)
    assert data == {"algorithm": "dddqn", "mix": {"easy": 0.5, "hard": 0.5}, "dqn": {"batch_size": 5}}
    assert resolve(data).learning.dqn.batch_size == 5


@pytest.mark.parametrize(
    ("sets", "data"),
    [
        ([], {}),
        (["seed=5"], {"seed": 5}),
        (["a.b=1", "a.c=x", "d=0.5"], {"a": {"b": 1, "c": "x"}, "d": 0.5}),
        (["a.b=1", "a.b=2"], {"a": {"b": 2}}),
        (["a=[1, 2]"], {"a": [1, 2]}),
        (["a={b: 1}", "a.c=2"], {"a": {"b": 1, "c": 2}}),
        (["a=true"], {"a": True}),
        (["a=2024-13-45"], {"a": "2024-13-45"}),
        (["a=1e-3"], {"a": 0.001}),
        (["a=b=c"], {"a": "b=c"}),
    ],
)
def test_settings_are_keys_and_yaml_values(sets, data):
    assert parse_sets(sets) == data


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("seed", "--set 'seed' is not key=value: write for example --set dqn.batch_size=64"),
        ("=5", "--set '=5' is not key=value: write for example --set dqn.batch_size=64"),
        ("seed=[1", "--set seed: '[1' is not a YAML value: while parsing a flow sequence"),
        ("seed=a: b: c", "--set seed: 'a: b: c' is not a YAML value: mapping values are not allowed here"),
        ("dqn={double: 1, double: 2}", "--set dqn: '{double: 1, double: 2}' is not a YAML value: the key 'double' is"),
        ("seed=" + "[" * 5000, f"--set seed: '{'[' * 76}... is not a YAML value: more than 32 lists and mappings in"),
        (
            ".".join("a" * 33) + "=1",
            "--set 'a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a': no key",
        ),
        ("demonstrations=", "--set 'demonstrations=' has no value: give one, or null"),
        ("seed=  ", "--set 'seed=  ' has no value: give one, or null"),
    ],
)
def test_a_wrong_setting_is_named(setting, text):
    assert complaint(parse_sets, [setting]).startswith(text)


@pytest.mark.parametrize("name", ["cluster", "dqn", "mix", "replay"])
def test_a_file_leaves_no_section_empty_that_an_option_could_complete(tmp_path, name):
    path = tmp_path / "run.yaml"
    path.write_text(f"start_from:\n{name}:\n")
    assert complaint(read_file, path) == f"{path}: {name} is empty: give it keys, or leave it out"


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("easy=2", {"easy": 2}),
        ("easy=2,hard=1,any=3", {"easy": 2, "hard": 1, "any": 3}),
        (" easy=2 , medium=0", {"easy": 2, "medium": 0}),
    ],
)
def test_actors_are_counts_by_level(text, counts):
    assert parse_actors(text) == counts


@pytest.mark.parametrize(
    ("text", "start"),
    [
        ("", "actors '' is not level=count: write for example easy=2,hard=1"),
        ("easy", "actors 'easy' is not level=count"),
        ("easy=", "actors 'easy=' is not level=count"),
        ("easy=two", "actors 'easy=two' is not level=count"),
        ("easy=-1", "actors 'easy=-1' is not level=count"),
        ("easy=1,,", "actors '' is not level=count"),
        ("easy=1,easy=2", "actors 'easy=2': easy is there twice, leave one out"),
        ("easy=257", "actors 'easy=257': at most 256 of a level"),
        ("easy=" + "9" * 5000, "actors 'easy=999"),
    ],
)
def test_wrong_actors_are_named(text, start):
    assert complaint(parse_actors, text).startswith(start)


def test_a_raised_two_is_no_number_of_actors():
    complaint(parse_actors, "easy=²")


TREES = st.recursive(
    st.integers() | st.text(max_size=3),
    lambda children: st.dictionaries(st.sampled_from("abc"), children, max_size=3),
    max_leaves=6,
)
MAPPINGS = st.dictionaries(st.sampled_from("abc"), TREES, max_size=3)


@settings(deadline=None)
@given(below=MAPPINGS, above=MAPPINGS)
def test_merging_lays_one_over_the_other(below, above):
    assert merge({}, above) == above
    assert merge(below, {}) == below
    if field := covered(below, above):
        assert complaint(merge, below, above).startswith(f"{field}: cannot be both ")
        return
    merged = merge(below, above)
    assert merge(merged, above) == merged
    leaves = flat(above)
    assert {key: flat(merged).get(key) for key in leaves} == leaves
    kept = {
        key: value
        for key, value in flat(below).items()
        if not any(key == above_ or key.startswith(f"{above_}.") for above_ in leaves)
    }
    assert {key: flat(merged).get(key) for key in kept} == kept


def covered(below, above, path=""):
    """Where a mapping of `above` lies over something of `below` that is none; None: nowhere."""
    for key, value in above.items():
        if isinstance(value, dict) and key in below:
            if not isinstance(below[key], dict):
                return f"{path}{key}"
            if found := covered(below[key], value, f"{path}{key}."):
                return found
    return None


def test_a_mapping_may_lie_over_nothing():
    assert merge({"a": None, "b": {"c": None}}, {"a": {"x": 1}, "b": {"c": {"y": 2}}}) == {
        "a": {"x": 1},
        "b": {"c": {"y": 2}},
    }
    assert merge({"a": {"x": 1}}, {"a": None}) == {"a": None}


def test_a_mapping_over_something_else_is_refused():
    assert complaint(merge, {"a": {"b": 5}}, {"a": {"b": {"c": 1}}}) == (
        "a.b: cannot be both 5 and {'c': 1}: give one of them"
    )
    assert complaint(parse_sets, ["dqn=5", "dqn.batch_size=3"]).startswith("dqn: cannot be both 5 and ")


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(["a", "b.c", "b.d", "e.f.g"]), st.integers(-(2**63), 2**63 - 1), max_size=4))
def test_settings_come_back_flat(data):
    assert flat(parse_sets([f"{key}={yaml.safe_dump(value).split()[0]}" for key, value in data.items()])) == data


@pytest.mark.parametrize(
    ("algorithm", "given", "text"),
    [
        ("ppo", {"dqn": {"double": True}}, "dqn: rule ppo has no use for it, leave it out"),
        ("ppo", {"replay": "prioritized"}, "replay: rule ppo has no use for it, leave it out"),
        ("ppo", {"exploration": {"decay_share": 0.1}}, "exploration: rule ppo has no use for it, leave it out"),
        ("ppo", {"fragment_steps": 3}, "fragment_steps: rule ppo has no use for it, leave it out"),
        ("ppo", {"network": "dueling"}, "network.kind: input should be 'actor-critic' or 'exits', not 'dueling'"),
        ("dddqn", {"sil": {"epochs": 3}}, "sil: rule dqn has no use for it, leave it out"),
        (
            "dddqn",
            {"network": "recurrent"},
            "network.kind: input should be 'plain', 'dueling' or 'dueling-apart', not 'recurrent'",
        ),
        ("dddqn", {"replay": {"alpha": 0.3}}, "unknown key replay.alpha: known are capacity, kind"),
        ("dddqn", {"replay": "priority"}, "replay.kind: unknown 'priority': known are 'uniform', 'prioritized'"),
        ("drqn", {"network": "dueling"}, "network.kind: input should be 'recurrent', not 'dueling'"),
        ("ppor", {"replay": "prioritized"}, "replay.kind: input should be 'uniform', not 'prioritized'"),
        ("sil", {"replay": "uniform"}, "replay.kind: input should be 'prioritized', not 'uniform'"),
        (
            "sil",
            {"replay": {"beta": 0.4}},
            "replay.beta 0.4: self-imitation is to favour what turned out well, make it 0",
        ),
    ],
)
def test_what_an_algorithm_does_not_have_is_said_before_anything_starts(algorithm, given, text):
    assert complaint(resolve, {"algorithm": algorithm, **given}) == text


# Levels of one's own


def test_levels_of_ones_own_make_a_run():
    config = resolve({"levels": {"rush": RUSH, "unused": RUSH}, "level": "rush"})
    assert list(config.world.levels) == ["rush"]
    assert config.world.bounds == (30, 40, 20)
    assert (config.mix, config.cluster.actors, config.evaluation.levels) == ({"rush": 1.0}, {"rush": 0}, 50)
    mixed = resolve({"levels": {"rush": RUSH}, "mix": {"easy": 0.5, "rush": 0.5}})
    assert list(mixed.world.levels) == ["easy", "rush"]
    assert mixed.cluster.actors == {"easy": 0, "rush": 0}


@pytest.mark.parametrize(
    ("trains", "like"),
    [(1, "easy"), (3, "easy"), (4, "easy"), (5, "medium"), (6, "medium"), (7, "hard"), (200, "hard")],
)
def test_a_presets_settings_follow_the_shipped_level_with_about_as_many_trains(trains, like):
    for algorithm in ("ddqn", "ppor", "sil"):
        mine = resolve({"algorithm": algorithm, "levels": {"mine": RUSH | {"trains": trains}}, "level": "mine"})
        assert mine.learning == resolve({"algorithm": algorithm, "level": like}).learning


def test_no_more_levels_are_evaluated_than_are_kept_from_training():
    few = {"levels": {"rush": RUSH | {"held_out": 10}}}
    assert resolve({"level": "rush"} | few).evaluation.levels == 10
    assert resolve({"mix": {"rush": 0.5, "easy": 0.5}} | few).evaluation.levels == 10
    assert complaint(resolve, {"level": "rush", "evaluation": {"levels": 11}} | few) == (
        "evaluation.levels 11: rush keeps only 10 from training, use no more"
    )


@pytest.mark.parametrize(
    ("given_", "text"),
    [
        (
            {"levels": {"rush": RUSH}, "level": "ruhs"},
            "unknown level 'ruhs': did you mean rush? known are easy, hard, ",
        ),
        ({"levels": {"rush": RUSH | {"trains": 0}}, "level": "rush"}, "levels.rush.trains: input should be greater"),
        ({"levels": {"rush": RUSH | {"trains": 0}}}, "levels.rush.trains: input should be greater"),  # also unused ones
        ({"levels": {"rush": 5}}, "levels.rush: say rules: legacy or rules: stock, or give files, not 5"),
        ({"levels": {"any": RUSH}, "level": "any"}, "levels: any is what actors serve that serve all levels: choose"),
        ({"levels": {"easy": RUSH}}, "levels.easy: these levels ship with the project, give yours another name"),
        ({"levels": {"a/b": RUSH}, "level": "a/b"}, "levels.a/b: string should match pattern"),
        ({"levels": {5: RUSH}, "mix": {5: 1}}, "levels.5: input should be a valid string, not 5"),
        ({"levels": []}, "levels: input should be a valid dictionary, not []"),
        ({"levels": None}, "levels: input should be a valid dictionary, not None"),
        (
            {"levels": {"rush": RUSH}, "level": "rush", "cluster": {"actors": {"rush": 1, "easy": 1}}},
            "actors for level easy, which this run does not have: it has rush",
        ),
        (
            {"levels": {"rush": RUSH}, "level": "rush", "cluster": {"actors": {"easy": 1}}},
            "no actors for level rush: add --actors rush=1",
        ),
        ({"mix": {"easy": 0.5, "rush": 0.5}}, "unknown level 'rush': known are easy, hard, medium"),
        (
            {"levels": {"rush": RUSH | {"speeds": {1: 0.5}}}},
            "levels.rush: the shares of speeds add up to 0.5: make it 1",
        ),
        (
            {"levels": {"rush": RUSH | {"malfunctions": 1}}},
            "levels.rush.malfunctions: input should be a valid dictionary",
        ),
        ({"observation": "gloval"}, "observation.kind: unknown 'gloval': known are 'tree', 'global'"),
        ({"observation": 5}, "observation: input should be a valid dictionary, not 5"),
        ({"observation": {"depth": 4}}, "observation.depth: input should be less than or equal to 3, not 4"),
        ({"reward": "delays"}, "reward.kind: unknown 'delays': known are 'study', 'delay'"),
        ({"decisions": "allways"}, "decisions: input should be 'cells', 'legacy' or 'always', not 'allways'"),
    ],
)
def test_what_is_wrong_with_the_world_is_named(given_, text):
    assert complaint(resolve, given_).startswith(text)


def test_a_run_of_levels_of_ones_own_goes_on_with_or_without_their_file():
    given_ = {"levels": {"rush": RUSH, "other": RUSH}, "level": "rush"}
    saved = resolve(given_)
    assert resolve_existing(saved, {}, "one") == saved
    assert resolve_existing(saved, given_, "one") == saved
    assert resolve_existing(saved, {"levels": {"other": RUSH}}, "one") == saved
    assert complaint(resolve_existing, saved, {"levels": {"other": 3}}, "one") == complaint(
        resolve, {"levels": {"rush": RUSH, "other": 3}, "level": "rush"}
    )


@pytest.mark.parametrize(
    ("changes", "was"),
    [
        ({"trains": 21}, "levels.rush.trains 20, not 21"),
        ({"speeds": {0.5: 1}}, "levels.rush.speeds.0.5 None, not 1.0"),
        ({"held_out": 90}, "levels.rush.held_out 100, not 90"),
        (
            {"malfunctions": {"rate": 0.5, "min_steps": 1, "max_steps": 2}},
            "levels.rush.malfunctions.rate None, not 0.5",
        ),
    ],
)
def test_other_levels_of_the_same_name_make_another_run(changes, was):
    saved = resolve({"levels": {"rush": RUSH}, "level": "rush"})
    assert complaint(resolve_existing, saved, {"levels": {"rush": RUSH | changes}}, "one") == (
        f"run one exists with {was}: leave the option out to go on with it, or give another --name"
    )
    assert complaint(resolve_existing, saved, {"levels": {"rush": RUSH | {"trains": 0}}}, "one").startswith(
        "levels.rush.trains: input should be greater"
    )


# Plain data


@pytest.mark.parametrize("path", sorted(SAVED.glob("*.yaml")), ids=lambda path: path.stem)
def test_an_earlier_configuration_may_be_a_run_file(path):
    saved = yaml.safe_load(path.read_text())
    config = parse_config(saved)
    assert resolve(saved) == config
    assert resolve(read_file(path) | {"seed": 7}).seed == 7
    assert resolve_existing(config, saved, "one") == config
    whole = saved | {"fragment_steps": None}
    assert resolve(whole) == parse_config(whole)  # a preset does not give it fragments


@st.composite
def speeds(draw):
    shares = draw(st.lists(st.integers(1, 9), min_size=1, max_size=3))
    each = draw(
        st.lists(st.sampled_from([1.0, 0.5, 0.33, 0.25, 0.2]), min_size=len(shares), max_size=len(shares), unique=True)
    )
    return {speed: share / sum(shares) for speed, share in zip(each, shares, strict=True)}


COMMON = {
    "size": st.tuples(st.integers(40, 200), st.integers(40, 200)),  # where so much always has room
    "trains": st.integers(1, 50),
    "cities": st.integers(2, 4),
    "held_out": st.integers(1, 1000),
}
LEVELS = st.fixed_dictionaries(COMMON | {"rules": st.just("legacy")}) | st.fixed_dictionaries(
    COMMON | {"rules": st.just("stock"), "timetable": st.booleans(), "speeds": st.none() | speeds()}
)
WORLDS = st.fixed_dictionaries(
    {
        "observation": st.sampled_from(["tree", "global", {"kind": "tree", "depth": 1}]),
        "decisions": st.sampled_from(["cells", "legacy", "always"]),
        "reward": st.sampled_from(["study", "delay"]),
        "lag": st.sampled_from([0, 3, "free"]),
    }
)


@pytest.mark.parametrize("algorithm", algorithms())
@settings(deadline=None, max_examples=25)
@given(levels=LEVELS, world=WORLDS)
def test_a_run_of_any_preset_and_levels_comes_back_from_its_file(algorithm, levels, world):
    config = resolve({"algorithm": algorithm, "levels": {"mine": levels}, "level": "mine"} | world)
    again = yaml.safe_load(yaml.safe_dump(config.plain(), sort_keys=False))
    assert parse_config(again) == config
    assert parse_config(again).science == config.science
    assert resolve(again) == config  # a saved configuration is a run file, too
    assert resolve_existing(config, again, "one") == config


def test_keys_are_found_from_wherever_the_run_goes_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {"cluster": {"listen": "tls/0.0.0.0:7447", "keys": "keys"}}
    saved = resolve(given, Path("files"))
    assert saved.cluster.keys == str(tmp_path / "files" / "keys")
    assert resolve_existing(saved, {}, "one").cluster == saved.cluster
    assert resolve_existing(saved, given, "one").cluster.keys == str(tmp_path / "keys")
    closed = parse_sets(["cluster.listen=null", "cluster.keys=null"])
    assert resolve_existing(saved, closed, "one").cluster == resolve({}).cluster


ODD = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(max_size=4)
    | st.sampled_from(["easy", "any", "auto", "tls/a:1", "1e400", "x" * 10_000, 10**400, -1, 0, 2**31, 2**63]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3) | st.just("kind"), inner, max_size=3)
    ),
    max_leaves=6,
)


def places_in(data, above=()):
    """The path of every value in a mapping of mappings."""
    for key, value in data.items():
        yield (*above, key)
        if isinstance(value, dict):
            yield from places_in(value, (*above, key))


@fuzz
@pytest.mark.parametrize("algorithm", algorithms())
@cases(50)
@given(data=st.data())
def test_any_value_in_any_place_of_a_run_file_is_taken_or_refused_in_one_line(algorithm, data):
    run = resolve({"algorithm": algorithm}).plain()
    for place in data.draw(st.lists(st.sampled_from(list(places_in(run))), min_size=1, max_size=3)):
        section = run
        for key in place[:-1]:
            section = section.get(key) if isinstance(section, dict) else None
        if isinstance(section, dict):
            section[data.draw(st.just(place[-1]) | st.text(max_size=3))] = data.draw(ODD)
    try:
        config = resolve(run)
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017
        assert len(str(error)) < 1000  # noqa: PT017
    else:
        assert parse_config(config.plain()) == config
