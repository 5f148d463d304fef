"""Which sizes have room for how many cities: where the library has it, as the library says."""

import pytest
from flatland.envs.rail_generators import SparseRailGen
from flatland.utils.seeding import np_random

from railctl.common.levels.check import check
from railctl.common.levels.distributions import LegacyLevels, StockLevels
from railctl.common.levels.generate import generate
from railctl.common.levels.room import Room, room_of
from railctl.common.strict import ConfigError
from railctl.tools.levels.library import forget_rails


def stock(size: tuple[int, int], pairs: int = 2, cities: int = 2) -> StockLevels:
    return StockLevels(rules="stock", size=size, trains=1, cities=cities, rail_pairs_in_city=pairs)


@pytest.mark.parametrize(
    ("size", "pairs", "room"),
    [
        ((25, 25), 2, Room(4, 2, 0)),  # cities of radius 4: 23 // 10 in a row
        ((18, 10), 1, Room(2, 1, 0)),  # of radius 3: 16 // 8 times 8 // 8
        ((18, 18), 2, Room(4, 1, 0)),  # 16 // 10 is 1: fewer pairs
        ((14, 14), 2, Room(4, 1, 1)),  # 12 // 8 is 1: radius 2
        ((10, 10), 2, Room(4, 1, 2)),  # 8 // 6 is 1: radius 1
        ((10, 6), 1, Room(2, 1, 2)),
        ((9, 9), 1, None),
    ],
)
def test_room_by_hand(size: tuple[int, int], pairs: int, room: Room | None):
    assert room_of(stock(size, pairs)) == room


@pytest.mark.parametrize("side", range(10, 40, 3))
@pytest.mark.parametrize("pairs", [1, 2, 3])
def test_nothing_is_changed_where_the_library_has_room(side: int, pairs: int):
    room = room_of(stock((side, side), pairs))
    try:
        SparseRailGen(max_num_cities=9, max_rail_pairs_in_city=pairs).generate(side, side, 1, np_random=np_random(1)[0])
    except ValueError as error:
        assert "Cannot fit more than one city" in str(error)  # noqa: PT017
        assert (room.rail_pairs, room.spared) != (pairs, 0)
    else:
        assert (room.rail_pairs, room.spared) == (pairs, 0)
    forget_rails()


@pytest.mark.parametrize("model", [StockLevels, LegacyLevels])
@pytest.mark.parametrize(("size", "trains"), [((10, 10), 1), ((10, 6), 1), ((14, 14), 2), ((6, 30), 3)])
def test_small_sizes_have_levels(model, size: tuple[int, int], trains: int):
    levels = model(rules="stock" if model is StockLevels else "legacy", size=size, trains=trains, cities=2)
    drawn = [generate(levels, seed) for seed in range(6)]
    assert all(level.grid.shape == size and level.n_trains == trains for level in drawn)
    assert len({level.grid_hash for level in drawn}) > 1


@pytest.mark.parametrize(
    ("levels", "problem"),
    [
        (stock((8, 8)), r"levels\.tiny\.size \[8, 8\] has no room for two cities: make it \[10, 6\] or more"),
        (
            stock((10, 10), cities=5),
            r"levels\.tiny\.cities 5: no more than 4 fit on 10x10: lower it, or make size larger",
        ),
    ],
)
def test_what_can_never_be_generated_is_refused(levels: StockLevels, problem: str):
    with pytest.raises(ConfigError, match=f"^{problem}$"):
        check("tiny", levels)


def test_what_ships_has_room():
    check("rush", stock((40, 40), cities=9))
