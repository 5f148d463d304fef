"""The difficulty of every episode follows from mix and seed alone."""

import pytest

from railctl.common.config import parse_config
from railctl.common.seeding import training_level_seed
from railctl.deploy.resolve import resolve
from railctl.services.learner.schedule import Schedule


def config(mix, seed=1, episodes=12, actors=None):
    return parse_config(
        {
            "algorithm": "dddqn",
            "mix": mix,
            "episodes": episodes,
            "seed": seed,
            "network": {},
            "dqn": {"learning_rate": 0.001, "batch_size": 8, "learn_every_steps": 4},
            "replay": {"capacity": 100},
            "rule": "dqn",
            "cluster": {"actors": actors or {"any": 1}},
        }
    )


def levels_of(config):
    return Schedule.of(config).levels


def test_what_leases_say_follows_from_the_configuration():
    exploring = Schedule.of(config({"easy": 1}, seed=3))
    assert (exploring.lag, exploring.fragment_steps, exploring.unsaved) == (0, None, 50)
    assert [exploring.epsilon(episode) for episode in (0, 11)] == [0.9, pytest.approx(0.01, abs=0.1)]
    assert exploring.level_seed(5) == training_level_seed(3, 5)


def test_a_run_knows_what_its_trains_are():
    study = Schedule.of(resolve({"algorithm": "drqn", "level": "medium", "network": {"hidden": [16, 8]}}))
    assert (study.trains["medium"], study.n_state) == (5, 32)
    found = {"digest": "0" * 16, "size": [30, 30], "trains": 4, "training": 9, "evaluation": 50}
    own = {"mine": {"files": "mine/*.pkl", "found": found}}
    files = Schedule.of(parse_config(config({"easy": 1}).plain() | {"levels": own, "mix": {"mine": 1}}))
    assert (files.trains["mine"], files.n_state) == (4, 0)


def test_a_run_of_one_difficulty_has_only_that():
    assert list(levels_of(config({"hard": 1}, episodes=5))) == ["hard"] * 5


def test_the_schedule_of_a_mix_is_pinned():
    assert "".join(level[0] for level in levels_of(config({"easy": 0.5, "medium": 0.3, "hard": 0.2}))) == "ehhhemmeeeem"


def test_the_order_in_which_a_mix_is_written_does_not_matter():
    one = levels_of(config({"easy": 0.5, "medium": 0.3, "hard": 0.2}, episodes=200))
    other = levels_of(config({"hard": 0.2, "easy": 0.5, "medium": 0.3}, episodes=200))
    assert list(one) == list(other)


def test_a_longer_run_begins_like_a_shorter_one():
    mix = {"easy": 0.5, "hard": 0.5}
    assert list(levels_of(config(mix, episodes=300)))[:100] == list(levels_of(config(mix, episodes=100)))


def test_seeds_differ_and_actors_do_not_matter():
    mix = {"easy": 0.5, "hard": 0.5}
    ours = list(levels_of(config(mix, seed=1, episodes=64)))
    assert ours != list(levels_of(config(mix, seed=2, episodes=64)))
    assert ours == list(levels_of(config(mix, seed=1, episodes=64, actors={"easy": 3, "hard": 1})))


@pytest.mark.parametrize("mix", [{"easy": 0.5, "hard": 0.5}, {"easy": 0.1, "medium": 0.2, "hard": 0.7}])
def test_shares_are_kept(mix):
    found = list(levels_of(config(mix, episodes=5000)))
    assert set(found) == set(mix)
    for difficulty, share in mix.items():
        deviation = (share * (1 - share) / 5000) ** 0.5
        assert abs(found.count(difficulty) / 5000 - share) < 4 * deviation


def test_shares_that_do_not_quite_add_up_to_one_still_name_a_difficulty(monkeypatch):
    monkeypatch.setattr("railctl.common.seeding.uniform", lambda _key, _counter: 1 - 2**-53)
    mix = {"easy": 0.1, "hard": 0.7, "medium": 0.2 - 1e-12}
    assert set(levels_of(config(mix))) == {"medium"}
