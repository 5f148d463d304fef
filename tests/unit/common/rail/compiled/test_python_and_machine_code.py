"""Kernels do the same compiled and as plain Python."""

import os
import subprocess
from pathlib import Path

import numpy as np
import played

from railctl.common.interpreter import PYTHON
from railctl.common.rail.compiled.arrays import NOTHING, SINGLE, WAYS
from railctl.common.rail.compiled.malfunctions import next_word
from railctl.common.rail.compiled.paths import count_bits, number_cells, ways_out
from railctl.common.rail.compiled.step import leave
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.world import N_ACTIONS

HERE = Path(__file__).parent


def test_a_small_episode_is_the_same_without_compilation():
    process = subprocess.run(
        [*PYTHON, "-W", "error", str(HERE / "played.py")],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": f"{HERE.parents[4]}:{HERE.parent}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.stderr == ""
    assert process.stdout.strip() == played.digest()


def test_tables_and_moves_are_the_same():
    grid, starts, targets = played.LEVEL.grid, played.LEVEL.starts, played.LEVEL.targets
    height, width = grid.shape
    tables = [(np.ones((height + 2) * (width + 2), np.int32), np.ones(grid.size + 1, np.int32)) for _ in range(2)]
    assert number_cells(grid, starts, targets, *tables[0]) == 9
    assert number_cells.py_func(grid, starts, targets, *tables[1]) == 9
    numbers, places = tables[0]
    np.testing.assert_array_equal(numbers, tables[1][0])
    np.testing.assert_array_equal(places[:9], tables[1][1][:9])
    assert numbers[places[:9]].tolist() == list(range(9))
    assert np.count_nonzero(numbers != NOTHING) == 9
    for piece in np.unique(grid).tolist():
        assert count_bits(piece) == count_bits.py_func(piece) == piece.bit_count()
        for heading in range(4):
            assert ways_out(piece, heading) == ways_out.py_func(piece, heading)
    world = CompiledWorld(1, 3)
    world.load(0, played.LEVEL)
    codes, leads = world.batch.codes[0], world.batch.leads[0]
    for here in np.flatnonzero(codes & WAYS).tolist():
        for action in range(N_ACTIONS):
            to = leave(codes, leads, here, action)
            assert to == leave.py_func(codes, leads, here, action)
            assert to != NOTHING or not codes[here] & SINGLE


def test_random_words_are_the_same():
    words = np.append(np.random.RandomState(5).get_state()[1], np.uint32(624)).astype(np.uint32)
    twin = words.copy()
    assert [next_word(words) for _ in range(700)] == [next_word.py_func(twin) for _ in range(700)]
    np.testing.assert_array_equal(words, twin)
