"""What the ways of two trains have to do with each other: 15 numbers in [-1, 1], 0 where there is nothing.

A stretch is a part of both ways that the two run through in opposite directions: the first one of my way. Nearness is
1 - cells / 50, or 0 beyond; margins are steps / 20, kept within -1 and 1; see `common.rail.compiled.ways` for steps.

| number | meaning | value |
|---|---|---|
| 0 | there is a stretch | 0 or 1 |
| 1 | how near its begin is to me | nearness |
| 2 | its length | cells / 20, at most 1 |
| 3 | how near its other end is to the other train | nearness |
| 4 | if I go first: the steps from my leaving the stretch to the other's coming in | margin |
| 5 | if the other goes first: the steps from its leaving the stretch to my coming in | margin |
| 6 | where I could wait: cells before the stretch that are not on the other's way | number / 5, at most 1 |
| 7 | where the other could wait: cells before the stretch that are not on my way | number / 5, at most 1 |
| 8, 9 | the other is in the stretch; I am | 0 or 1 |
| 10 | the first cell where we cross: due within a step, from different sides; or at once, from the same | nearness |
| 11 | the first cell to which the other comes from the same side | nearness |
| 12 | by how many steps the other is there before me | margin |
| 13 | the first cell of my way in which the other is now | nearness |
| 14 | how much longer than mine its way is | cells / 50, kept within -1 and 1 |

Where a train could wait, the place where it is counts, too, be it off the map.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE
from railctl.common.rail.compiled.ways import Ways, steps_to

NEAR_CELLS: Final = 50.0
STRETCH_CELLS: Final = 20.0
MARGIN_STEPS: Final = 20.0
MANY_PLACES: Final = 5
NEVER: Final = 1e9  # steps


@bare_kernel
def scaled(x: float, scale: float) -> float:
    """A share of a scale, kept within -1 and 1."""
    return max(-1.0, min(1.0, x / scale))


@bare_kernel
def nearness(cells: float) -> float:
    """1 for what is here, 0 for what is 50 cells away or more."""
    return max(0.0, 1.0 - cells / NEAR_CELLS)


@bare_kernel
def compare(ways: Ways, mine: int, other: int, numbers: NDArray[np.float32]) -> float:
    """Fill in the numbers [15], zeros so far, of two rows of `ways`.

    Returns:
        Steps until I am where we cross, or a stretch begins, whichever is first; NEVER if there is no such place.
    """
    path, theirs, places = ways.paths[mine], ways.paths[other], ways.places[other]
    length, their_length = int(ways.lengths[mine]), int(ways.lengths[other])
    begin = end = enters = leaves = NOTHING
    crosses = follows = meets = NOTHING
    for at in range(1, length):
        here = int(path[at])
        place = int(places[here >> 2])
        if place == NOTHING:
            continue
        if meets == NOTHING and place == 0:
            meets = at
        same = theirs[place] == here
        if follows == NOTHING and same:
            follows = at
        if crosses == NOTHING:
            apart = abs(steps_to(ways, mine, at) - steps_to(ways, other, place))
            if apart < 1 or (apart == 1 and not same):
                crosses = at
        opposes = place + 1 < their_length and theirs[place + 1] >> 2 == path[at - 1] >> 2
        if opposes and (begin == NOTHING or end == at - 1):
            if begin == NOTHING:
                begin, leaves = at - 1, place + 1
            end, enters = at, place
    soon = NEVER
    if begin != NOTHING:
        soon = steps_to(ways, mine, begin)
        numbers[0] = 1
        numbers[1] = nearness(begin)
        numbers[2] = scaled(end - begin + 1, STRETCH_CELLS)
        numbers[3] = nearness(enters)
        numbers[4] = scaled(steps_to(ways, other, enters) - steps_to(ways, mine, end), MARGIN_STEPS)
        numbers[5] = scaled(steps_to(ways, mine, begin) - steps_to(ways, other, leaves), MARGIN_STEPS)
        numbers[6] = waits_before(path, begin, places)
        numbers[7] = waits_before(theirs, enters, ways.places[mine])
        numbers[8] = enters == 0
        numbers[9] = begin == 0
    if crosses != NOTHING:
        soon = min(soon, steps_to(ways, mine, crosses))
        numbers[10] = nearness(crosses)
    if follows != NOTHING:
        numbers[11] = nearness(follows)
        ahead = steps_to(ways, mine, follows) - steps_to(ways, other, int(places[path[follows] >> 2]))
        numbers[12] = scaled(ahead, MARGIN_STEPS)
    if meets != NOTHING:
        numbers[13] = nearness(meets)
    numbers[14] = scaled(their_length - length, NEAR_CELLS)
    return soon


@bare_kernel
def waits_before(path: NDArray[np.int32], end: int, places: NDArray[np.int16]) -> float:
    """Number 6 or 7: of a path before its place `end`, beside a path that has these `places`."""
    count = 0
    for at in range(end):
        if path[at] == NOWHERE or places[path[at] >> 2] == NOTHING:
            count += 1
            if count == MANY_PLACES:
                break
    return count / MANY_PLACES
