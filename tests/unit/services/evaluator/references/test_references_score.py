"""Scoring a reference policy: what is said of it, and that it says the same of the same levels."""

import json

import numpy as np
import pytest
from made_rails import scheduled

from railctl.common.levels import files
from railctl.common.levels.level import Malfunctions
from railctl.common.levels.supply import LevelSupply
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.requests import ORDERS, LevelChoice, ReferenceRequest
from railctl.common.strict import ConfigError
from railctl.services.evaluator.references.__main__ import score
from railctl.services.evaluator.references.policies import INTERLOCKINGS, reference_policy
from railctl.services.evaluator.runner import UnplayableLevelError, evaluate

SUPPLY = LevelSupply()
OFTEN = Malfunctions(0.05, 2, 6)


def request(policy, draws=0, orders=ORDERS, **levels):
    return ReferenceRequest(policy=policy, draws=draws, orders=orders, levels=LevelChoice(**levels))


@pytest.fixture
def scored(capsys):
    """The document that is printed for this request."""

    def run(policy, **asked):
        score(request(policy, **asked))
        *progress, result = capsys.readouterr().out.splitlines()
        assert [list(json.loads(line)) for line in progress] == [["progress"]] * len(progress)
        return json.loads(result)

    return run


def test_every_difficulty_is_a_row_of_the_evaluation_levels(scored):
    document = scored("shortest-path", episodes=3)
    assert list(document) == ["checkpoint", "algorithm", "episode", "mode", "draws", "policy", "orders", "rows"]
    assert list(document.values())[:7] == [None] * 5 + ["shortest-path", None]
    assert [row["level"] for row in document["rows"]] == ["easy", "medium", "hard"]
    levels = [SUPPLY.evaluation("hard", index) for index in range(3)]
    expected = evaluate(reference_policy("shortest-path", CompiledWorld(1, 7)), levels)
    assert document["rows"][2]["returns"] == expected.returns.tolist()


@pytest.mark.parametrize("policy", INTERLOCKINGS)
def test_behind_an_interlocking_trains_that_broke_down_are_bound(scored, tmp_path, policy):
    """What they were granted they do before anything else, which only a world with the interlocking knows."""
    levels = [scheduled(SUPPLY.evaluation("hard", index), malfunctions=OFTEN) for index in range(8)]
    files.save(tmp_path / "levels.npz", {"any": levels})
    returns = scored(policy, file=tmp_path / "levels.npz")["rows"][0]["returns"]
    modes = (INTERLOCKINGS[policy], "off")
    worlds = [CompiledWorld(1, 7, rules="stock", interlocking=mode) for mode in modes]
    with_it, without = (evaluate(reference_policy(policy, world), levels).returns.tolist() for world in worlds)
    assert returns == with_it != without


def test_the_planner_tries_as_many_orders_as_are_asked_for_and_no_fewer_find_better_plans(scored):
    given = {"names": ("hard",), "episodes": 5}
    one, many = scored("planner", orders=1, **given), scored("planner", **given)
    assert (one["orders"], many["orders"]) == (1, 50)
    pairs = zip(one["rows"][0]["returns"], many["rows"][0]["returns"], strict=True)
    assert all(first <= best for first, best in pairs)
    assert one["rows"] != many["rows"]
    assert scored("planner", **given)["rows"] == many["rows"]


def test_draws_follow_their_seed(scored, tmp_path):
    files.save(tmp_path / "levels.npz", {"any": [SUPPLY.evaluation("easy", 0)] * 2})
    first, again, other = (
        scored("random", file=tmp_path / "levels.npz", draws=seed)["rows"][0]["returns"] for seed in (1, 1, 2)
    )
    assert first == again != other
    assert first[0] != first[1]  # the number of the level counts, too


def test_what_cannot_be_played_is_refused(tmp_path):
    level = SUPPLY.evaluation("easy", 0)
    level.grid[0, 0] = 0b1000_0000_0010_0000  # north and south, at the upper edge
    files.save(tmp_path / "levels.npz", {"any": [level]})
    with pytest.raises(UnplayableLevelError, match=r"levels.npz: any, level 0: the level's rails lead off the grid$"):
        score(request("planner", file=tmp_path / "levels.npz"))
    with pytest.raises(ConfigError, match=r"^--episodes 1001: "):
        score(request("planner", episodes=1001))


def test_there_may_be_many_trains(scored, tmp_path):
    level = SUPPLY.evaluation("hard", 0)
    again = np.arange(30) % level.n_trains
    crowd = type(level)(level.grid, level.starts[again], level.targets[again], level.max_steps)
    files.save(tmp_path / "levels.npz", {"jam": [crowd]})
    for name in ("random", "alone", "deadlock-avoidance", "planner"):
        [row] = scored(name, file=tmp_path / "levels.npz")["rows"]
        assert row["returns"] == [row["mean"]], name
    assert row["all_arrived_share"] == 1
