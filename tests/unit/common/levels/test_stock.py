"""Stock levels are what flatland-rl's own environment draws, and nothing else depends on them."""

import random

import numpy as np
import pytest
from flatland.envs.rail_grid_transition_map import RailGridTransitionMap

from common.levels import stock
from common.levels.stock import SPECS, StockSpec, generate

SLOW = StockSpec(trains=4, cities=2, speeds={1.0: 0.5, 0.5: 0.5}, malfunctions=(0.01, 2, 6))


@pytest.mark.parametrize("difficulty", SPECS)
def test_a_level_is_the_library_s_own(difficulty):
    drawn = generate(SPECS[difficulty], 3)
    env = stock.environment(SPECS[difficulty], 3)
    env.reset(random_seed=3)
    np.testing.assert_array_equal(drawn.grid, env.rail.grid)
    assert drawn.n_trains == SPECS[difficulty].trains
    assert drawn.max_steps == env._max_episode_steps
    assert drawn.schedule.earliest_departures.tolist() == [agent.earliest_departure for agent in env.agents]
    assert drawn.schedule.latest_arrivals.tolist() == [agent.latest_arrival for agent in env.agents]
    assert drawn.schedule.malfunctions is None
    starts = [(*agent.initial_configuration[0], int(agent.initial_configuration[1])) for agent in env.agents]
    assert [tuple(start) for start in drawn.starts.tolist()] == starts


def test_without_a_timetable_every_train_may_depart_at_once():
    drawn = generate(StockSpec(trains=3, cities=2, timetable=False), 3)
    assert not any(drawn.schedule.earliest_departures)
    assert drawn.max_steps == 412
    assert drawn.schedule.latest_arrivals.tolist() == [412] * 3


def test_speeds_and_malfunctions_come_with_the_level():
    drawn = [generate(SLOW, seed) for seed in range(4)]
    assert {up / down for one in drawn for up, down in one.schedule.speeds.tolist()} == {0.5, 1.0}
    assert all(one.schedule.malfunctions == (0.01, 2, 6) for one in drawn)


def test_a_seed_gives_its_level_whatever_the_global_generators_hold():
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002  (the global generator is what is tested)
    before = random.getstate(), np.random.get_state()[1].tolist()  # noqa: NPY002
    first = generate(SPECS["hard"], 9)
    assert random.getstate() == before[0]
    assert np.random.get_state()[1].tolist() == before[1]  # noqa: NPY002
    random.seed(2)
    assert generate(SPECS["hard"], 9).content_hash == first.content_hash
    assert generate(SPECS["hard"], 10).content_hash != first.content_hash
    assert RailGridTransitionMap.get_transitions.cache_info().currsize == 0


def test_a_draw_with_a_train_that_cannot_arrive_is_drawn_anew(monkeypatch: pytest.MonkeyPatch):
    answers = iter([False, True])
    monkeypatch.setattr(stock, "_is_feasible", lambda _env, _trains: next(answers))
    assert generate(SPECS["easy"], 3).n_trains == 3
    monkeypatch.setattr(stock, "_is_feasible", lambda _env, _trains: False)
    monkeypatch.setattr(stock, "LEVEL_TRIES", 2)
    with pytest.raises(stock.InfeasibleLevelError, match="no feasible level for seed 3 in 2 tries"):
        generate(SPECS["easy"], 3)
