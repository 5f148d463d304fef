"""Tree observations: raw, as flatland gives them, or as the vector of `common.rail.normalise`.

Source: `TreeObsForRailEnv` and `ShortestPathPredictorForRailEnv` of flatland-rl 4.3.0 and 2.2.2. Three of them:

| mode | |
|---|---|
| STOCK | 4.3.0: the predicted conflict is always infinite |
| LEGACY | 2.2.2: conflicts are found, trains that have arrived are invisible, speeds are constant |
| REPAIRED | 4.3.0 with conflicts found; it counts arrived trains as standing where they arrived |

Cells are told apart on all grids; where a grid is taller than wide, flatland's conflicts confuse some of them.

A tree of depth d has 1 + 4 + ... + 4^d nodes: root, left, forward, right, back, each followed by its own, pre-order.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import (
    AHEAD_SHIFT,
    DEAD_END,
    DONE,
    IS_OCCUPIED,
    IS_TARGET,
    LOOPS,
    NOTEWORTHY,
    NOWHERE,
    PLAIN,
    SINGLE,
    UNREACHED,
    UNUSABLE,
    WAYS,
    Batch,
)
from railctl.common.rail.compiled.ways import Ways, ways_for
from railctl.common.rail.interlocking.signals import Signals, signals_for
from railctl.common.rail.observations.traffic_shape import N_EXITS, N_MEETING

STOCK: Final = 0
LEGACY: Final = 1
REPAIRED: Final = 2

N_NODE_FEATURES: Final = 12
DEEPEST: Final = 3
MOST_BRANCHES: Final = 4 * DEEPEST  # that wait to be explored: of the node in hand, and those before it
MOST_PREDICTED_STEPS: Final = 62  # moments are bits
ALL: Final = np.uint64(0xFFFFFFFFFFFFFFFF)
ONE: Final = np.uint64(1)
AROUND: Final = np.uint64(7)  # a moment, the one before and the one after
INFINITE: Final = np.float32(np.inf)


def nodes_of(depth: int) -> int:
    """How many nodes a tree of a depth has."""
    return ((1 << 2 * depth + 2) - 1) // 3


class Sight(NamedTuple):
    """Where trains will be, and room to work: for one world at a time.

    The last five are of `common.rail.observations.traffic`.

    Attributes:
        forecasts: [N, P + 1] int32, the configuration of each train in so many steps, NOWHERE for an invisible one.
        once, twice: [C] uint64, the moments at which one train or more, two or more, are forecast to be in a cell, a
            bit each.
        path: [P] int32.
        branches: [MOST_BRANCHES, 4] int32, still to be explored: configuration, distance, node, nodes of its subtree.
        present: [85] int32, the nodes of the tree that there are; room for the deepest.
        stamps: [4C + 1] int64, the last branch that saw a configuration, and at the end their number.
        ways: of all trains.
        signals: of the interlocking.
        meetings: [N, 3, 15] float32, what the way of each other train has to do with that behind an exit.
        soon: [N, 4] float64, steps to the first conflict behind each exit, and behind any.
        apart: [N] int32, cells to another train, or NOTHING.
    """

    forecasts: NDArray[np.int32]
    once: NDArray[np.uint64]
    twice: NDArray[np.uint64]
    path: NDArray[np.int32]
    branches: NDArray[np.int32]
    present: NDArray[np.int32]
    stamps: NDArray[np.int64]
    ways: Ways
    signals: Signals
    meetings: NDArray[np.float32]
    soon: NDArray[np.float64]
    apart: NDArray[np.int32]


def sight_of(batch: Batch, predicted_steps: int) -> Sight:
    """Room to look into the worlds of `batch`."""
    n_trains, cells = batch.trains.shape[1], batch.cells.shape[1]
    return Sight(
        forecasts=np.zeros((n_trains, predicted_steps + 1), np.int32),
        once=np.zeros(cells, np.uint64),
        twice=np.zeros(cells, np.uint64),
        path=np.zeros(predicted_steps, np.int32),
        branches=np.zeros((MOST_BRANCHES, 4), np.int32),
        present=np.zeros(nodes_of(DEEPEST), np.int32),
        stamps=np.zeros(cells * 4 + 1, np.int64),
        ways=ways_for(batch),
        signals=signals_for(batch),
        meetings=np.zeros((n_trains, N_EXITS, N_MEETING), np.float32),
        soon=np.zeros((n_trains, N_EXITS + 1)),
        apart=np.zeros(n_trains, np.int32),
    )


@bare_kernel
def standpoint(train: np.void, mode: int) -> int:
    """The configuration from which a train looks: where it is, will depart from, or arrived; NOWHERE if invisible."""
    if train["config"] != NOWHERE:
        return int(train["config"])
    if train["state"] != DONE:
        return int(train["start"])
    return NOWHERE if mode == LEGACY else int(train["finish"])


@bare_kernel
def forecast(batch: Batch, slot: int, sight: Sight, mode: int) -> None:
    """Where all trains of a world will be, if each keeps to its shortest path and nobody hinders it."""
    codes, leads, trains = batch.codes[slot], batch.leads[slot], batch.trains[slot]
    once, twice, path = sight.once, sight.twice, sight.path
    moments = len(path) + 1
    once[: batch.worlds[slot]["cells"]] = 0
    twice[: batch.worlds[slot]["cells"]] = 0
    for at in range(batch.worlds[slot]["trains"]):
        forecasts, train = sight.forecasts[at], trains[at]
        here = standpoint(train, mode)
        if here == NOWHERE:
            forecasts[:] = NOWHERE
            continue
        moves = 0
        if train["state"] != DONE:
            moves = shortest_path(codes, leads, batch.distances[slot, at], here, path)
        stay = int(train["steps_per_cell"])
        begin = moved = 0
        while begin < moments:
            stays = moved == moves or here >> 2 == train["target"]
            end = moments if stays else min(moments, begin + stay)
            for moment in range(begin, end):
                forecasts[moment] = here
            when = (ALL >> np.uint64(64 - end + begin)) << np.uint64(begin)
            twice[here >> 2] |= once[here >> 2] & when
            once[here >> 2] |= when
            if not stays:
                here = int(path[moved])
                moved += 1
            begin = end


@bare_kernel
def shortest_path(
    codes: NDArray[np.int32], leads: NDArray[np.int32], distances: NDArray[np.int16], here: int, path: NDArray[np.int32]
) -> int:
    """Fill `path` with the configurations after `here`; how many.

    Left goes before forward before right. As in flatland, the last step of a path that does not reach its target in
    time is not taken, and a train without a way stays where it is.
    """
    most = len(path)
    best = UNREACHED
    length = 0
    while distances[here] != 0 and length < most:
        code = int(codes[here])
        ahead = NOWHERE
        if code & SINGLE:
            ahead = code >> AHEAD_SHIFT
            if distances[ahead] >= best:
                return 0
            best = int(distances[ahead])
        else:
            for turn in range(3, 6):
                way = (here + turn) & 3
                if code >> way & 1:
                    to = int(leads[(here & ~3) + way])
                    if distances[to] < best:
                        best, ahead = int(distances[to]), to
            if ahead == NOWHERE:
                return 0
        path[length] = ahead
        length += 1
        here = ahead
    return length - 1 if length == most else length


@bare_kernel
def meets(
    codes: NDArray[np.int32],
    trains: NDArray[np.void],
    sight: Sight,
    n_trains: int,
    at: int,
    here: int,
    time: int,
    mode: int,
) -> bool:
    """Whether another train is due in the cell of `here` about `time`, and faces a way out.

    Only the first moment at which others are there counts; then flatland counts this train, too.
    """
    forecasts, cell = sight.forecasts, here >> 2
    once, twice = sight.once[cell], sight.twice[cell]
    for moment in (time, time - 1, min(forecasts.shape[1] - 1, time + 1)):
        now = np.uint64(moment)
        if once >> now & ONE and (twice >> now & ONE or forecasts[at, moment] >> 2 != cell):
            code = int(codes[here])
            for other in range(n_trains):
                there = int(forecasts[other, moment])
                if there >> 2 == cell:
                    if (there ^ here) & 3 and code >> ((there + 2) & 3) & 1:
                        return True
                    if mode == REPAIRED and trains[other]["state"] == DONE:
                        return True
            return False
    return False


@bare_kernel
def grow(batch: Batch, slot: int, at: int, sight: Sight, mode: int, depth: int, nodes: NDArray[np.float32]) -> int:
    """Write the rows of a train's tree into [nodes, 12]; how many there are, which `sight.present` tells.

    The train must be visible; where conflicts are found, `forecast` comes first.
    """
    codes, leads, cells = batch.codes[slot], batch.leads[slot], batch.cells[slot]
    trains, distances = batch.trains[slot], batch.distances[slot, at]
    branches, stamps = sight.branches, sight.stamps
    unit = batch.worlds[slot]["unit"]
    own_target, time_per_cell = int(trains[at]["target"]), trains[at]["time_per_cell"]
    n_trains = int(batch.worlds[slot]["trains"])
    predicted = 0 if mode == STOCK else len(sight.path) + 1
    once = sight.once
    here = standpoint(trains[at], mode)

    speed = trains[at]["full_speed"] if mode == LEGACY else trains[at]["speed"]
    for feature in range(9):
        nodes[0, feature] = 0
    nodes[0, 6] = INFINITE if distances[here] == UNREACHED else distances[here]
    nodes[0, 9] = trains[at]["malfunction"]
    nodes[0, 10] = speed / unit
    nodes[0, 11] = 0
    sight.present[0] = 0
    count = 1

    size = 1  # nodes of a subtree of the root
    for _ in range(depth - 1):
        size = 1 + 4 * size
    code = int(codes[here])
    facing = code >> AHEAD_SHIFT if code & SINGLE else here
    waiting = 0
    for turn in range(4):
        way = (facing + turn + 3) & 3
        if code >> way & 1:
            branches[waiting, 0] = leads[(here & ~3) + way]
            branches[waiting, 1] = 1
            branches[waiting, 2] = 1 + turn * size
            branches[waiting, 3] = size
            waiting += 1
    while waiting > 0:
        waiting -= 1
        here, steps = int(branches[waiting, 0]), int(branches[waiting, 1])
        node, size = int(branches[waiting, 2]), int(branches[waiting, 3])
        own = other = near = unusable = conflict = -1
        same = opposite = longest = ready = 0
        slowest = unit
        ends = False
        stamps[-1] += 1
        stamp = stamps[-1]
        horizon = predicted
        while True:
            code = int(codes[here])
            if steps < horizon:
                time = int(steps * time_per_cell)
                near_others = time < predicted and once[here >> 2] >> np.uint64(time - 1) & AROUND != 0
                if near_others and meets(codes, trains, sight, n_trains, at, here, time, mode):
                    conflict = steps
                    horizon = 0
            if code & NOTEWORTHY == PLAIN:
                here = code >> AHEAD_SHIFT
                steps += 1
                continue
            if code & IS_OCCUPIED:
                cell = cells[here >> 2]
                met = trains[cell["train"]]
                if near < 0:
                    near = steps
                longest = max(longest, int(met["malfunction"]))
                ready += cell["waiting"]
                if (met["config"] ^ here) & 3 == 0:
                    same += 1
                    slowest = min(slowest, met["full_speed"] if mode == LEGACY else met["speed"])
                else:
                    opposite += 1
            if code & IS_TARGET:
                if here >> 2 == own_target:
                    own = steps
                    break
                if other < 0:
                    other = steps
            if code & LOOPS:
                if stamps[here] == stamp:
                    ends = True
                    break
                stamps[here] = stamp
            if code & UNUSABLE and unusable < 0:
                unusable = steps
            if not code & SINGLE:
                ends = code & WAYS == 0
                break
            if code & DEAD_END:
                break
            here = code >> AHEAD_SHIFT
            steps += 1
        nodes[node, 0] = own if own >= 0 else INFINITE
        nodes[node, 1] = other if other >= 0 else INFINITE
        nodes[node, 2] = near if near >= 0 else INFINITE
        nodes[node, 3] = conflict if conflict >= 0 else INFINITE
        nodes[node, 4] = unusable if unusable >= 0 else INFINITE
        nodes[node, 5] = INFINITE if ends else steps
        nodes[node, 6] = 0 if own >= 0 else INFINITE if distances[here] == UNREACHED else distances[here]
        nodes[node, 7] = same
        nodes[node, 8] = opposite
        nodes[node, 9] = longest
        nodes[node, 10] = slowest / unit
        nodes[node, 11] = ready
        sight.present[count] = node
        count += 1
        if size > 1 and own < 0 and not ends:
            size = (size - 1) >> 2
            facing = here + 2 if code & DEAD_END else here  # a dead end is left backwards, which is called forward
            for turn in range(4):
                way = (facing + turn + 3) & 3
                if code >> way & 1:
                    branches[waiting, 0] = leads[(here & ~3) + way]
                    branches[waiting, 1] = steps + 1
                    branches[waiting, 2] = node + 1 + turn * size
                    branches[waiting, 3] = size
                    waiting += 1
    return count
