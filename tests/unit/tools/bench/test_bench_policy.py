"""Both sides play the same episodes: same rewards, step by step, or no times."""

from dataclasses import replace

import numpy as np
import pytest

from railctl.common.levels.distributions import shipped
from railctl.common.levels.legacy import generate
from railctl.common.levels.level import Level
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import export_parameters
from railctl.common.policy.player import Acting, network_layout, play
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.records.course import Course
from railctl.tools.bench import policy
from railctl.tools.bench.conditions import study_rollouts
from railctl.tools.bench.measuring import DisagreementError, measure
from railctl.tools.bench.policy import (
    NETWORK,
    OBSERVATIONS,
    TheirPlayer,
    comparison,
    comparisons,
    pathfinder,
    script_of,
)

EDGE = 30  # steps: enough for a start, and for a limit that is soon reached


def short(level: Level) -> Level:
    return replace(level, max_steps=EDGE)


def played(level: Level, *, greedy: bool, observation: str = "tree") -> Course:
    network = pathfinder(observation)
    twin = Twin(network_layout(NETWORK, network.n_features))
    twin.load(export_parameters(network))
    return play(study_rollouts(OBSERVATIONS[observation]), level, Acting(twin, 0.5, 7, greedy))


def test_the_networks_follow_the_shortest_path():
    level = generate(shipped()["easy"], 4)
    alone = replace(level, starts=level.starts[:1], targets=level.targets[:1])
    course = played(alone, greedy=True)
    root_distance = round((1 + float(course.decisions.observations[0][6])) * 100)
    assert course.arrived_at.tolist() == [root_distance]  # the first step only departs
    assert played(alone, greedy=True, observation="traffic").arrived_at.tolist() == [root_distance]


@pytest.mark.parametrize("level_name", [*shipped()])
def test_flatland_plays_our_episode_again(level_name: str):
    level = short(generate(shipped()[level_name], 2))
    script = script_of(level, played(level, greedy=False))
    assert sum(map(len, script.deciding)) == len(script.course.decisions)
    assert min(TheirPlayer(pathfinder()).play(script)) > 0


def test_another_episode_is_an_error():
    level = short(generate(shipped()["easy"], 2))
    script = script_of(level, played(level, greedy=False))
    script.course.rewards[-1] = np.zeros(3, np.float32)
    with pytest.raises(DisagreementError, match="another way"):
        TheirPlayer(pathfinder()).play(script)


@pytest.mark.parametrize(("observation", "interlocking"), [("tree", "off"), ("traffic", "off"), ("traffic", "planned")])
def test_rows_have_both_times(observation: str, interlocking: Interlocking):
    levels = [short(generate(shipped()["easy"], 1))]
    rows = measure([comparison("tiny", levels, observation, interlocking)], repeats=1)
    assert [(row.name, row.unit) for row in rows] == [
        ("step with policy tiny", "us/step"),
        ("episode with policy tiny", "ms/episode"),
    ]
    assert min(number for row in rows for number in (row.ours, row.theirs)) > 0


def test_all_levels_that_ship_are_measured(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(policy.torch, "set_num_threads", lambda _: None)
    assert [comparison.name for comparison in comparisons(worlds=1)] == [f"policy {name}" for name in shipped()]
