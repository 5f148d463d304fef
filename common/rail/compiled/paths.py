"""Laying a level into the tables of a batch: numbered cells, what each configuration offers, distances.

Source: `RailEnvTransitions`, `DistanceMap` and `TreeObsForRailEnv` of flatland-rl 4.3.0; distances are found by one
breadth-first search a target, backwards from all its configurations.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.rail.compiled.arrays import (
    AHEAD_SHIFT,
    DEAD_END,
    DECIDES,
    IS_TARGET,
    LOOPS,
    NOTHING,
    PLAIN,
    SINGLE,
    UNREACHED,
    UNUSABLE,
    WAYS,
    Batch,
)

DIAMOND_CROSSING = 0b1000010000100001  # flatland does not take it for a switch
ROWS_OF_STEPS = np.array([-1, 0, 1, 0])
COLUMNS_OF_STEPS = np.array([0, 1, 0, -1])


@bare_kernel
def ways_out(cell: int, heading: int) -> int:
    """The ways out of a cell of flatland's grid for a heading: bit 0 north to bit 3 west."""
    bits = cell >> (12 - 4 * heading) & 15
    return (bits & 1) << 3 | (bits & 2) << 1 | (bits & 4) >> 1 | bits >> 3


@bare_kernel
def count_bits(number: int) -> int:
    count = 0
    while number:
        number &= number - 1
        count += 1
    return count


@bare_kernel
def number_cells(
    grid: NDArray[np.uint16], starts: NDArray[np.int32], targets: NDArray[np.int32], numbers: NDArray[np.int32]
) -> int:
    """Number the cells of [H, W] that matter, the others NOTHING; how many, or NOTHING if rails lead off the grid."""
    height, width = grid.shape
    numbers[:] = NOTHING
    for train in range(len(starts)):
        numbers[starts[train, 0], starts[train, 1]] = 0
        numbers[targets[train, 0], targets[train, 1]] = 0
    for row in range(height):
        for column in range(width):
            if grid[row, column] == 0:
                continue
            numbers[row, column] = 0
            for heading in range(4):
                ways = ways_out(int(grid[row, column]), heading)
                for way in range(4):
                    if ways >> way & 1:
                        to_row, to_column = row + ROWS_OF_STEPS[way], column + COLUMNS_OF_STEPS[way]
                        if to_row < 0 or to_row >= height or to_column < 0 or to_column >= width:
                            return NOTHING
                        numbers[to_row, to_column] = 0
    count = 0
    for row in range(height):
        for column in range(width):
            if numbers[row, column] == 0:
                numbers[row, column] = count
                count += 1
    return count


@kernel
def lay_rails(batch: Batch, slot: int, grid: NDArray[np.uint16], numbers: NDArray[np.int32], count: int) -> None:
    """Fill `cells`, `codes` and `leads` of a slot; nobody is there yet."""
    height, width = grid.shape
    codes, leads, cells = batch.codes[slot], batch.leads[slot], batch.cells[slot]
    for row in range(height):
        for column in range(width):
            cell = numbers[row, column]
            if cell == NOTHING:
                continue
            cells[cell]["row"] = row
            cells[cell]["column"] = column
            cells[cell]["train"] = NOTHING
            cells[cell]["claim"] = NOTHING
            cells[cell]["waiting"] = 0
            piece = int(grid[row, column])
            bits = 2 if piece == DIAMOND_CROSSING else count_bits(piece)
            for heading in range(4):
                to_row, to_column = row + ROWS_OF_STEPS[heading], column + COLUMNS_OF_STEPS[heading]
                to = NOTHING
                if 0 <= to_row < height and 0 <= to_column < width:
                    to = numbers[to_row, to_column]
                leads[cell * 4 + heading] = NOTHING if to == NOTHING else to * 4 + heading
            for heading in range(4):
                codes[cell * 4 + heading] = code_of(ways_out(piece, heading), bits, leads[cell * 4 : cell * 4 + 4])
    mark_loops(codes, count * 4)
    mark_decisions(codes, leads, grid, cells, count)


@bare_kernel
def code_of(ways: int, bits: int, leads: NDArray[np.int32]) -> int:
    """The code of a configuration with these ways out, in a cell of so many transitions, with these `leads` [4].

    What depends on more than the cell is left out.
    """
    exits = count_bits(ways)
    code = ways
    if exits == 1:
        way = 0 if ways == 1 else 1 if ways == 2 else 2 if ways == 4 else 3
        code |= SINGLE | int(leads[way]) << AHEAD_SHIFT
        if bits == 1:
            code |= DEAD_END
    if exits < 2 < bits:
        code |= UNUSABLE
    if exits == 1 and bits == 2:
        code |= PLAIN
    return code


@kernel
def mark_loops(codes: NDArray[np.int32], count: int) -> None:
    """Mark configurations from which single ways lead in a circle; such a place is not PLAIN."""
    stamps = np.zeros(count, np.int32)
    for start in range(count):
        here, stamp = start, start + 1
        while stamps[here] == 0 and codes[here] & SINGLE and not codes[here] & DEAD_END:
            stamps[here] = stamp
            here = codes[here] >> AHEAD_SHIFT
        if stamps[here] == stamp or codes[here] & LOOPS:
            here = start
            while codes[here] & SINGLE and not codes[here] & (DEAD_END | LOOPS):
                codes[here] = (codes[here] | LOOPS) & ~PLAIN
                here = codes[here] >> AHEAD_SHIFT


@bare_kernel
def mark_decisions(
    codes: NDArray[np.int32],
    leads: NDArray[np.int32],
    grid: NDArray[np.uint16],
    cells: NDArray[np.void],
    count: int,
) -> None:
    for here in range(count * 4):
        ways = codes[here] & WAYS
        decides = count_bits(ways) >= 2
        for way in range(4):
            if ways >> way & 1:
                ahead = cells[leads[(here & ~3) + way] >> 2]
                decides = decides or count_bits(int(grid[ahead["row"], ahead["column"]])) > 2
        if decides:
            codes[here] |= DECIDES


@kernel
def measure(batch: Batch, slot: int) -> None:
    """Fill `distances` of a slot, and mark the targets, once its trains have got theirs."""
    codes, leads = batch.codes[slot], batch.leads[slot]
    trains, distances = batch.trains[slot], batch.distances[slot]
    count = batch.worlds[slot]["cells"]
    queue = np.empty(count * 4, np.int32)
    for train in range(batch.worlds[slot]["trains"]):
        target, ways = trains[train]["target"], trains[train]["target_ways"]
        for here in range(target * 4, target * 4 + 4):
            codes[here] |= IS_TARGET
        distance = distances[train]
        known = False
        for other in range(train):
            if trains[other]["target"] == target and trains[other]["target_ways"] == ways:
                distance[: count * 4] = distances[other, : count * 4]
                known = True
                break
        if known:
            continue
        distance[: count * 4] = UNREACHED
        begin = end = 0
        for heading in range(4):
            if ways >> heading & 1:
                distance[target * 4 + heading] = 0
                queue[end] = target * 4 + heading
                end += 1
        while begin < end:
            here = queue[begin]
            begin += 1
            heading = here & 3
            before = leads[(here & ~3) + ((heading + 2) & 3)] >> 2  # the cell behind
            if before < 0:
                continue
            for other in range(before * 4, before * 4 + 4):
                if codes[other] >> heading & 1 and distance[other] == UNREACHED:
                    distance[other] = distance[here] + 1
                    queue[end] = other
                    end += 1
