"""Episodes that policies play where a run would act its own."""

import json

import numpy as np
import pytest

from railctl.common.demonstrations import digest_of, read_demonstrations
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.player import compiled_world
from railctl.common.rail.compiled.arrays import NOWHERE
from railctl.common.records.course import NONE
from railctl.common.requests import DemonstrationRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import training_level_seed
from railctl.common.strict import ConfigError
from railctl.deploy.resolve import resolve
from railctl.services.evaluator.demonstrate import demonstrate
from railctl.services.evaluator.references.planner import best_ways

PLAIN = resolve({"algorithm": "ppo", "level": "easy", "seed": 3})
SIGNALLED = resolve({"algorithm": "dispatch", "level": "easy", "seed": 3})


def courses_of(path, config, policy, episodes=3, **more):
    demonstrate(
        DemonstrationRequest(policy=policy, orders=3, config=config.plain(), episodes=episodes, file=path, **more)
    )
    heading, courses = read_demonstrations(path)
    assert heading.world == digest_of(config.world)
    return list(courses)


@pytest.mark.parametrize(
    ("config", "policy"),
    [(PLAIN, "planner"), (PLAIN, "planner-replanned"), (SIGNALLED, "planner-replanned")],
)
def test_planners_get_all_trains_home_on_the_levels_of_a_run(tmp_path, capsys, config, policy):
    courses = courses_of(tmp_path / "some.demos", config, policy)
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    levels = [LevelSupply().training("easy", training_level_seed(3, episode)) for episode in range(3)]
    assert [course.level_hash for course in courses] == [level.content_hash for level in levels]
    assert all((course.arrived_at != NONE).all() for course in courses)
    assert told["decisions"] == sum(len(course.decisions) for course in courses)
    assert told["mean"] == np.mean([course.normalised_return for course in courses])
    assert told["arrived_share"] == 1


def test_the_plan_comes_true_though_trains_are_asked_only_where_they_decide(tmp_path):
    [course] = courses_of(tmp_path / "some.demos", PLAIN, "planner", episodes=1)
    level = LevelSupply().training("easy", training_level_seed(3, 0))
    world = compiled_world(PLAIN.world, "legacy", level.n_trains)
    world.load(0, level)
    ways = best_ways(3, 3, 0, world.parts(), anywhere=False)
    last = [int(np.flatnonzero(way != NOWHERE)[-1]) for way in ways]
    assert course.arrived_at.tolist() == [step - 1 for step in last]
    assert len(course.decisions) < course.last_step * level.n_trains


def test_the_shortest_path_goes_as_the_interlocking_of_the_run_allows(tmp_path):
    for course in courses_of(tmp_path / "some.demos", SIGNALLED, "shortest-path-planned"):
        decisions = course.decisions
        assert (decisions.allowed < 31).any()
        waits = decisions.actions == 4
        assert (decisions.allowed[waits] & 0b1110 == 0).all()  # for nothing but want of a move


def test_a_checkpoint_plays_as_its_run_scores_it_or_as_is_asked(tmp_path, write_checkpoint):
    network = write_checkpoint(tmp_path / "weights.safetensors", NetworkConfig(kind="actor-critic"), seed=1)
    sampled, again, best = (
        courses_of(tmp_path / f"{number}.demos", PLAIN, None, checkpoint=network, mode=mode)
        for number, mode in enumerate(("sample", "sample", "greedy"))
    )
    actions = [[course.decisions.actions.tolist() for course in courses] for courses in (sampled, again, best)]
    assert actions[0] == actions[1] != actions[2]
    assert all((course.decisions.log_probabilities < 0).all() for course in sampled)


def test_a_checkpoint_that_sees_something_else_is_refused(tmp_path, write_checkpoint):
    network = write_checkpoint(tmp_path / "weights.safetensors", NetworkConfig(kind="actor-critic"), seed=1)
    with pytest.raises(ConfigError, match="give the run its observation"):
        courses_of(tmp_path / "some.demos", SIGNALLED, None, checkpoint=network)


@pytest.mark.parametrize(
    ("config", "policy", "text"),
    [
        (SIGNALLED, "planner", "planner: an interlocking (planned) may forbid what it has planned"),
        (PLAIN, "shortest-path-planned", "shortest-path-planned: it goes as an interlocking allows, here off"),
        (PLAIN, None, "policy and checkpoint are missing"),
    ],
)
def test_who_would_not_be_himself_is_refused(tmp_path, config, policy, text):
    with pytest.raises(ConfigError) as caught:
        courses_of(tmp_path / "some.demos", config, policy)
    assert str(caught.value).startswith(text)
    assert list(tmp_path.iterdir()) == []
