"""Stock levels are pure and say all that they should; that they are the library's is tested in `compiled`."""

import random

import numpy as np
import pytest
from flatland.envs.step_utils.speed_counter import _pseudo_fractional
from hypothesis import example, given
from hypothesis import strategies as st

from railctl.common.levels import stock
from railctl.common.levels.check import check
from railctl.common.levels.distributions import StockLevels
from railctl.common.levels.generate import generate
from railctl.common.levels.level import InfeasibleLevelError, Malfunctions
from railctl.common.levels.speeds import speed_fraction
from railctl.common.strict import ConfigError

SPEEDS = {0.5: 0.3, 1.0: 0.5, 0.33: 0.2}
EASY = StockLevels(rules="stock", size=(25, 25), trains=3, cities=2)
HARD = StockLevels(rules="stock", size=(25, 25), trains=7, cities=3)


def test_the_order_in_which_speeds_are_given_changes_nothing():
    given_otherwise = HARD.model_copy(update={"speeds": dict(reversed(SPEEDS.items()))})
    assert (
        generate(given_otherwise, 5).content_hash
        == generate(HARD.model_copy(update={"speeds": SPEEDS}), 5).content_hash
    )


def test_without_a_timetable_every_train_may_depart_at_once():
    level = generate(EASY.model_copy(update={"timetable": False}), 3)
    assert not level.schedule.earliest_departures.any()
    assert level.max_steps == 412
    assert level.schedule.latest_arrivals.tolist() == [412] * 3


def test_malfunctions_come_with_the_level():
    levels = StockLevels.model_validate(
        {**EASY.model_dump(), "malfunctions": {"rate": 0.01, "min_steps": 2, "max_steps": 6}}
    )
    assert generate(levels, 1).schedule.malfunctions == Malfunctions(0.01, 2, 6)
    assert generate(EASY, 1).schedule.malfunctions is None


def test_a_seed_gives_its_level_whatever_the_global_generators_hold():
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002  (the global generator is what is tested)
    before = random.getstate(), np.random.get_state()[1].tolist()  # noqa: NPY002
    first = generate(HARD, 9)
    assert random.getstate() == before[0]
    assert np.random.get_state()[1].tolist() == before[1]  # noqa: NPY002
    random.seed(2)
    assert generate(HARD, 9).content_hash == first.content_hash
    assert generate(HARD, 10).content_hash != first.content_hash


def test_a_draw_with_a_train_that_cannot_arrive_is_drawn_anew(monkeypatch: pytest.MonkeyPatch):
    draw, answers = stock._draw, iter([False, True])
    monkeypatch.setattr(stock, "_draw", lambda levels, state: draw(levels, state) if next(answers) else None)
    assert generate(EASY, 3).n_trains == 3
    monkeypatch.setattr(stock, "_draw", lambda _levels, _state: None)
    with pytest.raises(InfeasibleLevelError, match="no feasible level for seed 3 in 20 tries"):
        generate(EASY, 3)


@given(st.floats(min_value=0.002, max_value=1, allow_nan=False))
@example(0.33)
@example(0.25)
@example(0.4)
@example(2 / 3)
def test_speeds_are_the_library_s_fractions(speed: float):
    assert speed_fraction(speed) == _pseudo_fractional(speed)


@pytest.mark.parametrize("speed", [0, -0.5, 1.5, float("nan")])
def test_what_is_no_speed_is_refused(speed: float):
    with pytest.raises(ValueError, match="not above 0 and at most 1"):
        speed_fraction(speed)


def test_speeds_without_a_common_denominator_are_refused():
    levels = EASY.model_copy(update={"speeds": {0.7654321: 0.5, 1.0: 0.5}})
    with pytest.raises(ConfigError, match=r"levels\.rush\.speeds 0\.765432, 1: .*use rounder ones"):
        check("rush", levels)
