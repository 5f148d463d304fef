"""Compiled levels are those of flatland-rl's own generators, whatever the size, and fail where those fail."""

import numpy as np
import pytest
from from_library import legacy_level, stock_level

from railctl.common.levels import legacy, stock
from railctl.common.levels.compiled.rails import TracksLeaveGridError
from railctl.common.levels.compiled.twister import seeded
from railctl.common.levels.distributions import LegacyLevels, StockLevels, shipped
from railctl.common.levels.level import InfeasibleLevelError, Level

SPEEDS = {0.5: 0.3, 1.0: 0.5, 0.33: 0.2}
ODD_SPEEDS = {0.9: 0.2, 0.7: 0.3, 0.25: 0.1, 1.0: 0.4}


def old(rows: int, columns: int, trains: int, cities: int, **others: int) -> LegacyLevels:
    return LegacyLevels(rules="legacy", size=(rows, columns), trains=trains, cities=cities, **others)


def new(rows: int, columns: int, trains: int, cities: int, **others: object) -> StockLevels:
    return StockLevels(rules="stock", size=(rows, columns), trains=trains, cities=cities, **others)


LEGACY = [
    *((levels, 12) for levels in shipped().values()),
    (old(10, 10, 1, 2), 12),
    (old(6, 30, 3, 2), 8),
    (old(14, 14, 2, 4), 8),
    (old(11, 18, 2, 2, rails_in_city=2), 8),
    (old(30, 44, 12, 4, rails_between_cities=3, rails_in_city=5), 3),
    (old(40, 40, 6, 2, rails_between_cities=10, rails_in_city=10), 3),
    (old(40, 40, 10, 9), 2),
]
STOCK = [
    (new(25, 25, 3, 2), 8),
    (new(25, 25, 7, 3), 8),
    (new(10, 10, 1, 2), 12),
    (new(10, 6, 1, 2), 8),
    (new(14, 14, 2, 4), 8),
    (new(18, 10, 2, 2, rail_pairs_in_city=1, speeds=SPEEDS), 8),
    (new(33, 57, 5, 3, rail_pairs_in_city=3, rails_between_cities=6), 3),
    (new(30, 45, 10, 4, rails_between_cities=3, speeds=ODD_SPEEDS), 4),
    (new(60, 60, 6, 2, rail_pairs_in_city=10, rails_between_cities=8), 1),
    (new(40, 40, 20, 9, speeds=SPEEDS, timetable=False), 1),
]
LARGE = [
    (old(100, 100, 100, 20, rails_in_city=4), 1),
    (new(60, 60, 40, 12, rail_pairs_in_city=3, speeds=ODD_SPEEDS), 2),
    (new(100, 100, 200, 20, speeds=SPEEDS), 1),
    (new(100, 100, 50, 60, rail_pairs_in_city=1), 1),
]


def ours(levels: LegacyLevels | StockLevels, seed: int) -> Level | None:
    """Without another try."""
    if isinstance(levels, StockLevels):
        return stock._draw(levels, seeded(seed))
    try:
        return legacy._draw(levels, seeded(seed))
    except InfeasibleLevelError:
        return None


def same(levels: LegacyLevels | StockLevels, seed: int) -> None:
    expected = stock_level(levels, seed) if isinstance(levels, StockLevels) else legacy_level(levels, seed)
    found = ours(levels, seed)
    if expected is None or found is None:
        assert expected is found
        return
    for column in ("grid", "starts", "targets"):
        np.testing.assert_array_equal(getattr(found, column), getattr(expected, column), column, strict=True)
    assert found.max_steps == expected.max_steps
    assert type(found.max_steps) is int
    if expected.schedule is not None:
        for column in ("speeds", "earliest_departures", "latest_arrivals", "target_headings"):
            mine, theirs = getattr(found.schedule, column), getattr(expected.schedule, column)
            np.testing.assert_array_equal(mine, theirs, column, strict=True)
    assert found.content_hash == expected.content_hash


@pytest.mark.parametrize(("levels", "seeds"), [*LEGACY, *STOCK])
def test_levels_are_the_library_s(levels: LegacyLevels | StockLevels, seeds: int):
    for seed in range((seeds + 1) // 2):
        same(levels, seed)


@pytest.mark.slow
@pytest.mark.parametrize(("levels", "seeds"), [*((levels, 7 * seeds) for levels, seeds in (*LEGACY, *STOCK)), *LARGE])
def test_many_and_large_levels_are_the_library_s(levels: LegacyLevels | StockLevels, seeds: int):
    for seed in range(100, 100 + seeds):
        same(levels, seed)


def test_tracks_that_leave_the_grid_are_an_index_error_as_in_the_library():
    wide = old(40, 40, 6, 2, rails_between_cities=10, rails_in_city=10)
    with pytest.raises(IndexError, match="out of bounds"):
        legacy_level(wide, 27)
    with pytest.raises(TracksLeaveGridError, match="tracks leave the grid of 40x40"):
        legacy.generate(wide, 27)
