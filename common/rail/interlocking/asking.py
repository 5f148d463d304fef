# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Asking for actions: within a step trains are asked one after another, and what is granted binds those after.

    begin(...)                                    # once a step
    while (train := next_asked(...)) != NOTHING:
        bits = allowed(..., train)                # a bit for each action that it may take
        grant(..., train, action)                 # what it does

| mode | a train may |
|---|---|
| off | take any action |
| valid | stop, go on, and turn where rails do; no two of these actions do the same |
| safe | stop; go where its route is free (`routes`) if afterwards all trains can run home (`proof`) |
| planned | as safe, or once one train has stepped aside |

A train that was granted a move and could not make it, since it broke down, say, is bound to it: others count on it.
With patience a train that has stood on the map for so many steps may not stop again where it may go on, so that trains
do not wait for each other for ever out of politeness.
Who could go to where another one is that has to be asked is asked after it, so that it knows whether that one leaves.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE, SINGLE, UNREACHED, Batch
from railctl.common.rail.compiled.decisions import decides
from railctl.common.rail.compiled.step import destination
from railctl.common.rail.interlocking.proof import is_proven, settle, vanish
from railctl.common.rail.interlocking.routes import find_routes, is_free, lock, run_on
from railctl.common.rail.interlocking.signals import (
    ALL_ACTIONS,
    DECISIONS,
    MODE,
    OFF,
    PATIENCE,
    PLANNED,
    ROUNDS,
    SAFE,
    VALID,
    Signals,
)
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING

FORWARD: int = 1 << MOVE_FORWARD
STOP: int = 1 << STOP_MOVING
PATIENT_ROUNDS: int = 2  # in which trains let others be asked first


@bare_kernel
def begin(batch: Batch, slot: int, mode: int, decisions: int, signals: Signals) -> None:
    """Before the trains of a slot are asked in a step; `decisions` is the rule that says whom to ask."""
    numbers = signals.numbers
    numbers[MODE], numbers[DECISIONS], numbers[ROUNDS] = mode, decisions, 0
    for at in range(batch.worlds[slot]["trains"]):
        signals.trains[at]["asked"] = False
    if mode >= SAFE:
        find_routes(batch, slot, decisions, signals)
        rest_all(batch, slot, signals)


@bare_kernel
def next_asked(batch: Batch, slot: int, deciding: NDArray[np.bool_], signals: Signals) -> int:
    """The next train to ask, of those that decide [N]; NOTHING if all have been asked."""
    n_trains = batch.worlds[slot]["trains"]
    while signals.numbers[ROUNDS] <= PATIENT_ROUNDS:
        patient = signals.numbers[MODE] >= SAFE and signals.numbers[ROUNDS] < PATIENT_ROUNDS
        for at in range(n_trains):
            of = signals.trains[at]
            if deciding[at] and not of["asked"] and not (patient and waits(batch, slot, at, deciding, signals)):
                of["asked"] = True
                return at
        signals.numbers[ROUNDS] += 1
    return NOTHING


@bare_kernel
def waits(batch: Batch, slot: int, at: int, deciding: NDArray[np.bool_], signals: Signals) -> bool:
    """Whether some train that has still to be asked is where this one could go."""
    codes, leads = batch.codes[slot], batch.leads[slot]
    here = int(batch.trains[slot, at]["config"])
    if here == NOWHERE:
        return is_open(signals, deciding, at, int(batch.trains[slot, at]["start"]) >> 2)
    for way in range(4):
        if codes[here] >> way & 1 and is_open(signals, deciding, at, int(leads[(here & ~3) + way]) >> 2):
            return True
    return False


@bare_kernel
def is_open(signals: Signals, deciding: NDArray[np.bool_], at: int, cell: int) -> bool:
    """Whether another train is in a cell that has still to be asked."""
    other = signals.cells[cell]["occupant"]
    somebody = other != NOTHING and other != at  # noqa: PLR1714  (numba wants numbers of one kind)
    return bool(somebody and deciding[other] and not signals.trains[other]["asked"])


@bare_kernel
def valid(codes: NDArray[np.int32], train: np.void) -> int:
    """The actions that are there: a train may stop or go on; turn only where rails do; no two do the same."""
    off_map = train["config"] == NOWHERE
    here = int(train["start"] if off_map else train["config"])
    if codes[here] & SINGLE:
        return FORWARD | STOP
    bits, heading = STOP, here & 3
    if codes[here] >> heading & 1:
        bits |= FORWARD
    if codes[here] >> ((heading + 3) & 3) & 1:
        bits |= 1 << MOVE_LEFT
    if codes[here] >> ((heading + 1) & 3) & 1:
        bits |= 1 << MOVE_RIGHT
    if off_map:  # any that is there departs, wherever it turns
        return STOP | (FORWARD if bits & FORWARD else bits & ~STOP & -(bits & ~STOP))
    return bits


@bare_kernel
def allowed(batch: Batch, slot: int, mode: int, train: int, signals: Signals) -> int:
    """The actions that a train may take, a bit each.

    Any train that is not done may be asked about; where it does not decide, all that are there are allowed.
    """
    if mode == OFF:
        return ALL_ACTIONS
    codes, of = batch.codes[slot], batch.trains[slot, train]
    bits = valid(codes, of)
    if mode == VALID or not decides(of, codes, batch.worlds[slot]["unit"], int(signals.numbers[DECISIONS])):
        return bits
    if of["bound"] != NOTHING:
        return int(1 << of["bound"])
    safe = STOP
    for action in range(MOVE_LEFT, MOVE_RIGHT + 1):
        if bits >> action & 1 and is_safe(batch, slot, mode, train, action, signals):
            safe |= 1 << action
    patience = signals.numbers[PATIENCE]
    is_late = patience > 0 and of["config"] != NOWHERE and of["stood"] >= patience
    return safe & ~STOP if is_late and safe != STOP else safe


@bare_kernel
def grant(batch: Batch, slot: int, mode: int, train: int, action: int, signals: Signals) -> None:
    """A train takes an action that it is allowed: whoever is asked later in this step is told as much."""
    is_bound = batch.trains[slot, train]["bound"] != NOTHING  # then it has its route
    if mode < SAFE or is_bound or not MOVE_LEFT <= action <= MOVE_RIGHT:
        return
    length = set_route(batch, slot, train, action, signals)
    lock(signals.cells, signals.trains[train], signals.routes[train], length)
    signals.cells[signals.routes[train, 0] >> 2]["occupant"] = train
    rest_all(batch, slot, signals)


@bare_kernel
def set_route(batch: Batch, slot: int, at: int, action: int, signals: Signals) -> int:
    """Write down the route that an action leads to; returns its length, 0 if there is no way home from it."""
    train, route, distance = batch.trains[slot, at], signals.routes[at], batch.distances[slot, at]
    codes, on_map = batch.codes[slot], int(signals.trains[at]["length"])
    to = destination(codes, batch.leads[slot], train, action)
    if distance[to] == UNREACHED:
        return 0
    route[on_map] = to
    return run_on(codes, distance, route, on_map + 1, int(signals.numbers[DECISIONS]))


@bare_kernel
def is_safe(batch: Batch, slot: int, mode: int, at: int, action: int, signals: Signals) -> bool:
    """Whether a train's route after an action is free, leads somewhere, and leaves everybody a way home."""
    trains, of, n_trains = signals.trains, signals.trains[at], batch.worlds[slot]["trains"]
    on_map = int(of["length"])
    length = set_route(batch, slot, at, action, signals)
    if length == 0 or not is_free(signals, at, on_map, length):
        return False
    cell = signals.cells[signals.routes[at, 0] >> 2]
    occupant = int(cell["occupant"])  # itself, or who leaves where it departs
    for other in range(n_trains):
        trains[other]["kept"] = trains[other]["rest"]
    of["length"], cell["occupant"] = length, at
    settle(batch, slot, signals)
    goes = of["rest"] >= on_map or of["rest"] == NOTHING
    proven = is_proven(batch, slot, signals, at, mode == PLANNED and goes) and goes
    of["length"] = on_map
    cell["occupant"] = occupant
    for other in range(n_trains):
        trains[other]["rest"] = trains[other]["kept"]
    return proven


@bare_kernel
def rest_all(batch: Batch, slot: int, signals: Signals) -> None:
    """Find out where trains rest; what they claim is forgotten again."""
    settle(batch, slot, signals)
    for at in range(batch.worlds[slot]["trains"]):
        of = signals.trains[at]
        if of["rest"] != NOTHING:
            vanish(signals.cells, signals.routes[at], of["rest"], of["length"])
