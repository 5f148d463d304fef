"""Laying a level into the tables of a batch: numbered cells, what each configuration offers, distances.

Source: `RailEnvTransitions`, `DistanceMap` and `TreeObsForRailEnv` of flatland-rl 4.3.0; distances are found by one
breadth-first search a target, backwards from all its configurations.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.rail.compiled.arrays import (
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


@bare_kernel
def ways_out(cell: int, heading: int) -> int:
    """The ways out of a cell of flatland's grid for a heading: bit 0 north to bit 3 west."""
    bits = cell >> (12 - 4 * heading) & 15
    return (bits & 1) << 3 | (bits & 2) << 1 | (bits & 4) >> 1 | bits >> 3


@bare_kernel
def count_bits(number: int) -> int:
    """Of a number below 2^16; without a branch, as all here that goes through cells: no two levels are alike."""
    pairs = number - (number >> 1 & 0x5555)
    fours = (pairs & 0x3333) + (pairs >> 2 & 0x3333)
    eights = (fours + (fours >> 4)) & 0x0F0F
    return (eights + (eights >> 8)) & 31


@bare_kernel
def number_cells(
    grid: NDArray[np.uint16],
    starts: NDArray[np.int32],
    targets: NDArray[np.int32],
    numbers: NDArray[np.int32],
    places: NDArray[np.int32],
) -> int:
    """Number the cells that matter, row after row; how many, or NOTHING if rails lead off the grid.

    Args:
        grid: [H, W].
        starts: [N, 3], row, column, heading.
        targets: [N, 2], row, column.
        numbers: [(H + 2) * (W + 2)], the grid with a margin; overwritten with numbers, and NOTHING for other cells.
        places: [H * W + 1], overwritten with where the cells stand in `numbers`, in their order.
    """
    height, width = grid.shape
    line = width + 2
    numbers[:] = 0  # first: whether a cell matters
    count = 0
    for row in range(height):
        for column in range(width):
            places[count] = (row + 1) * line + column + 1
            count += grid[row, column] != 0
    for at in places[:count]:
        piece = int(grid[at // line - 1, at % line - 1])
        ways = ways_out(piece | piece >> 4 | piece >> 8 | piece >> 12, 3)
        numbers[at] = 1
        numbers[at - line] |= ways & 1
        numbers[at + 1] |= ways >> 1 & 1
        numbers[at + line] |= ways >> 2 & 1
        numbers[at - 1] |= ways >> 3
    if numbers[:line].any() or numbers[-line:].any() or numbers[::line].any() or numbers[line - 1 :: line].any():
        return NOTHING
    for train in range(len(starts)):
        numbers[(starts[train, 0] + 1) * line + starts[train, 1] + 1] = 1
        numbers[(targets[train, 0] + 1) * line + targets[train, 1] + 1] = 1
    count = 0
    for at in range(len(numbers)):
        matters = numbers[at]
        numbers[at] = count if matters else NOTHING
        places[count] = at
        count += matters
    return count


@kernel
def lay_rails(
    batch: Batch, slot: int, grid: NDArray[np.uint16], numbers: NDArray[np.int32], places: NDArray[np.int32]
) -> None:
    """Fill `cells`, `codes` and `leads` of a slot; nobody is there yet. `places` is as long as there are cells."""
    codes, leads, cells = batch.codes[slot], batch.leads[slot], batch.cells[slot]
    line = grid.shape[1] + 2
    forks = np.empty(len(places), np.bool_)
    for cell in range(len(places)):
        at, first = places[cell], cell * 4
        row, column = at // line - 1, at % line - 1
        cells[cell]["row"] = row
        cells[cell]["column"] = column
        cells[cell]["train"] = NOTHING
        cells[cell]["claim"] = NOTHING
        cells[cell]["waiting"] = 0
        leads[first] = lead(numbers[at - line], 0)
        leads[first + 1] = lead(numbers[at + 1], 1)
        leads[first + 2] = lead(numbers[at + line], 2)
        leads[first + 3] = lead(numbers[at - 1], 3)
        piece = int(grid[row, column])
        bits = count_bits(piece)
        forks[cell] = bits > 2
        bits = 2 if piece == DIAMOND_CROSSING else bits
        for heading in range(4):
            codes[first + heading] = code_of(ways_out(piece, heading), bits, leads[first : first + 4])
    mark_loops(codes, len(places) * 4)
    mark_decisions(codes[: len(places) * 4], forks)


@bare_kernel
def lead(cell: int, heading: int) -> int:
    """The configuration in a cell, NOTHING in none."""
    return NOTHING if cell == NOTHING else cell * 4 + heading


@bare_kernel
def code_of(ways: int, bits: int, leads: NDArray[np.int32]) -> int:
    """The code of a configuration with these ways out, in a cell of so many transitions, with these `leads` [4].

    What depends on more than the cell is left out.
    """
    exits = count_bits(ways)
    single = int(exits == 1)
    way = ((ways >> 1) - (ways >> 3)) & 3  # of a single one
    code = ways | single * (SINGLE | int(leads[way]) << AHEAD_SHIFT)
    code |= DEAD_END * (single & (bits == 1))
    code |= UNUSABLE * (exits < 2 < bits)
    return code | PLAIN * (single & (bits == 2))


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
def mark_decisions(codes: NDArray[np.int32], forks: NDArray[np.bool_]) -> None:
    """Mark where there is a choice, or the next cell is one of `forks`: those of more than two transitions."""
    for here in range(len(codes)):
        code = int(codes[here])
        single = (code & SINGLE) != 0
        ahead = code >> AHEAD_SHIFT >> 2  # 0 if there is no single one
        decides = (count_bits(code & WAYS) >= 2) | (single & forks[ahead])
        codes[here] = code | DECIDES * decides


@bare_kernel
def trace_back(
    codes: NDArray[np.int32], leads: NDArray[np.int32], before: NDArray[np.int32], counts: NDArray[np.int32]
) -> None:
    """Fill `before` [4C, 4] with the configurations from which trains come, `counts` [4C] with how many these are."""
    counts[:] = 0
    for here in range(len(counts)):
        ways = codes[here] & WAYS
        for way in range(4):
            if ways >> way & 1:
                to = leads[(here & ~3) + way]
                before[to, counts[to]] = here
                counts[to] += 1


@kernel
def measure(batch: Batch, slot: int) -> bool:
    """Fill `distances` of a slot, and mark the targets, once its trains have theirs; False if some are too large."""
    codes, leads = batch.codes[slot], batch.leads[slot]
    trains, distances = batch.trains[slot], batch.distances[slot]
    count = batch.worlds[slot]["cells"] * 4
    queue, counts, before = np.empty(count, np.int32), np.empty(count, np.int32), np.empty((count, 4), np.int32)
    trace_back(codes, leads, before, counts)
    for train in range(batch.worlds[slot]["trains"]):
        target, ways = trains[train]["target"], trains[train]["target_ways"]
        for here in range(target * 4, target * 4 + 4):
            codes[here] |= IS_TARGET
        distance = distances[train]
        known = False
        for other in range(train):
            if trains[other]["target"] == target and trains[other]["target_ways"] == ways:
                distance[:count] = distances[other, :count]
                known = True
                break
        if known:
            continue
        distance[:count] = UNREACHED
        begin = end = 0
        for heading in range(4):
            if ways >> heading & 1:
                distance[target * 4 + heading] = 0
                queue[end] = target * 4 + heading
                end += 1
        while begin < end:
            here = queue[begin]
            begin += 1
            for number in range(counts[here]):
                other = before[here, number]
                if distance[other] == UNREACHED:
                    if distance[here] + 1 == UNREACHED:
                        return False
                    distance[other] = distance[here] + 1
                    queue[end] = other
                    end += 1
    return True
