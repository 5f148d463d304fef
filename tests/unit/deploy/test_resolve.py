"""What the user says becomes a checked configuration: preset, file, options, `--set`; what is wrong is named."""

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from common.levels.distributions import shipped
from common.strict import ConfigError
from deploy.resolve import (
    algorithms,
    flat,
    merge,
    parse_actors,
    parse_sets,
    read_file,
    resolve,
    resolve_existing,
    spelled_out,
)


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
    assert config.cluster.actors == {level: 1}


def test_nothing_given_is_the_default_run():
    config = resolve({})
    assert (config.algorithm, config.mix, config.episodes, config.seed) == ("dddqn", {"easy": 1.0}, 1500, 1)


def test_a_level_may_have_settings_of_its_own():
    assert resolve({"level": "easy"}).dqn.learn_every_steps == 30
    assert resolve({"level": "medium"}).dqn.learn_every_steps == 40
    assert resolve({"level": "hard"}).dqn.learn_every_steps == 30


@pytest.mark.parametrize(
    ("mix", "steps"),
    [({"easy": 0.5, "medium": 0.5}, 40), ({"medium": 0.9, "hard": 0.1}, 30), ({"hard": 0.1, "easy": 0.9}, 30)],
)
def test_a_mix_has_the_settings_of_its_hardest_level_and_an_actor_for_each(mix, steps):
    config = resolve({"mix": mix})
    assert config.dqn.learn_every_steps == steps
    assert config.cluster.actors == dict.fromkeys(mix, 1)


def test_what_is_given_outranks_preset_and_level():
    config = resolve({"level": "medium", "discount": 0.5, "dqn": {"learn_every_steps": 7}})
    assert (config.discount, config.dqn.learn_every_steps) == (0.5, 7)
    assert config.dqn.batch_size == resolve({}).dqn.batch_size


def test_named_actors_replace_the_default_ones():
    assert resolve({"cluster": {"actors": {"any": 2}}}).cluster.actors == {"any": 2}
    assert resolve({"cluster": {"cores": 1}}).cluster.actors == {"easy": 1}


def test_resolving_changes_nothing_that_was_given():
    given_ = {"level": "hard", "cluster": {"cores": 1}}
    resolve(given_)
    assert given_ == {"level": "hard", "cluster": {"cores": 1}}


@pytest.mark.parametrize(
    ("given_", "text"),
    [
        ({"algorithm": "dddq"}, "unknown algorithm 'dddq': did you mean dddqn? known are dddqn"),
        ({"algorithm": None}, "unknown algorithm 'None'"),
        ({"level": "esy"}, "unknown level 'esy': did you mean easy? known are easy, hard, medium"),
        ({"level": ["easy"]}, "unknown level ['easy']"),
        ({"level": "easy", "mix": {"easy": 1}}, "level and mix are both given: leave one out"),
        ({"episods": 5}, "unknown key episods: did you mean episodes?"),
        ({"dqn": {"batchsize": 5}}, "unknown key dqn.batchsize: did you mean batch_size?"),
        ({"levels": {}}, "unknown key levels"),
        ({"episodes": "many"}, "episodes: input should be a valid integer"),
        ({"mix": {"esy": 1}}, "mix.esy: input should be 'easy', 'medium' or 'hard', not 'esy'"),
        ({"mix": "easy"}, "mix: input should be a valid dictionary, not 'easy'"),
        ({"dqn": 5}, "dqn: input should be a valid dictionary, not 5"),
        ({"cluster": {"actors": {"hard": 1}}}, "no actors for difficulty easy: add --actors easy=1"),
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
        ({"algorithm": "dqn"}, "algorithm dddqn, not dqn"),
        ({"dqn": {"batch_size": 5}}, "dqn.batch_size 150, not 5"),
        ({"network": {"hidden": [8]}}, "network.hidden [128, 128], not [8]"),
        ({"mix": {"easy": 0.5, "hard": 0.5}}, "level easy, not mix {'easy': 0.5, 'hard': 0.5}"),
        ({"level": "hard"}, "level easy, not level hard"),
        ({"level": "hard", "cluster": {"actors": {"any": 1}}}, "level easy, not level hard"),
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
    assert complaint(resolve_existing, existing(), {"level": "none"}, "one").startswith("unknown level 'none'")


# Its parts


def test_a_level_is_short_for_a_mix():
    assert spelled_out({"level": "hard", "seed": 1}) == {"mix": {"hard": 1.0}, "seed": 1}
    assert spelled_out({"mix": {"easy": 1}}) == {"mix": {"easy": 1}}
    assert spelled_out({}) == {}


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "No such file or directory: give an existing YAML file with -f"),
        (b"", "holds no keys: write for example 'algorithm: dddqn'"),
        (b"- easy\n- hard", "holds no keys"),
        (b"easy", "holds no keys"),
        (b"a: [1\nb: {", "is not YAML: while parsing a flow "),
        (b"a: !!python/object:os.system {}", "is not YAML: could not determine a constructor"),
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


@pytest.mark.parametrize("content", [b"\x89PNG\xff\xfe", b"seed: 2024-13-45", b"seed: " + b"1" * 5000])
def test_a_run_file_that_is_no_text_or_holds_impossible_values_is_named(tmp_path, content):
    path = tmp_path / "run.yaml"
    path.write_bytes(content)
    assert complaint(read_file, path).startswith(str(path))


def test_a_run_file_is_plain_data(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("algorithm: dddqn\nmix: {easy: 0.5, hard: 0.5}\ndqn:\n  batch_size: 5\n")
    data = read_file(path)
    assert data == {"algorithm": "dddqn", "mix": {"easy": 0.5, "hard": 0.5}, "dqn": {"batch_size": 5}}
    assert resolve(data).dqn.batch_size == 5


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
        (["a="], {"a": None}),
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
        ("seed=[1", "--set seed: '[1' is not a YAML value"),
        ("seed=a: b: c", "--set seed: 'a: b: c' is not a YAML value"),
    ],
)
def test_a_wrong_setting_is_named(setting, text):
    assert complaint(parse_sets, [setting]) == text


def test_a_setting_that_is_an_impossible_date_is_named():
    assert complaint(parse_sets, ["seed=2024-13-45"]) == "--set seed: '2024-13-45' is not a YAML value"


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("easy=2", {"easy": 2}),
        ("easy=2,hard=1,any=3", {"easy": 2, "hard": 1, "any": 3}),
        (" easy=2 , medium=0", {"easy": 2, "medium": 0}),
    ],
)
def test_actors_are_counts_by_difficulty(text, counts):
    assert parse_actors(text) == counts


@pytest.mark.parametrize(
    ("text", "start"),
    [
        ("", "actors '' is not difficulty=count: write for example easy=2,hard=1"),
        ("easy", "actors 'easy' is not difficulty=count"),
        ("easy=", "actors 'easy=' is not difficulty=count"),
        ("easy=two", "actors 'easy=two' is not difficulty=count"),
        ("easy=-1", "actors 'easy=-1' is not difficulty=count"),
        ("easy=1,,", "actors '' is not difficulty=count"),
        ("esy=1", "actors for unknown difficulty 'esy': did you mean easy? known are any, easy, hard, medium"),
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
    merged = merge(below, above)
    assert merge(merged, above) == merged
    assert merge({}, above) == above
    assert merge(below, {}) == below
    leaves = flat(above)
    assert {key: flat(merged).get(key) for key in leaves} == leaves


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(["a", "b.c", "b.d", "e.f.g"]), st.integers(), max_size=4))
def test_settings_come_back_flat(data):
    assert flat(parse_sets([f"{key}={yaml.safe_dump(value).split()[0]}" for key, value in data.items()])) == data


@pytest.mark.parametrize(
    ("algorithm", "given", "text"),
    [
        ("ppo", {"dqn": {"double": True}}, "algorithm ppo has no section dqn: it has ppo"),
        ("ppo", {"replay": "prioritized"}, "algorithm ppo has no section replay: it has ppo"),
        ("dddqn", {"sil": {"epochs": 3}}, "algorithm dddqn has no section sil: it has dqn, replay"),
        ("ppor", {"replay": "prioritized"}, "ppor draws all alike: make replay.kind uniform"),
        (
            "sil",
            {"replay": "uniform"},
            "self-imitation draws what turned out well: make replay.kind prioritized, replay.beta 0",
        ),
    ],
)
def test_what_an_algorithm_does_not_have_is_said_before_anything_starts(algorithm, given, text):
    with pytest.raises(ConfigError) as caught:
        resolve({"algorithm": algorithm, **given})
    assert str(caught.value) == text
