"""One step of a world: flatland-rl 4.3.0's rules, and those of 2.2.2 as they differ.

Source: `RailEnv.step`, `TrainStateMachine`, `SpeedCounter` and `MotionCheck` of flatland-rl 4.3.0 with
`remove_agents_at_target`, acceleration 1 and braking -1, and no level-free crossings; for 2.2.2 see `LegacyActions` in
`common.rail.flatland_env`. What trains are paid for a step is another matter: `common.rail.rewards`.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import (
    AHEAD_SHIFT,
    BROKEN,
    BROKEN_OFF_MAP,
    DONE,
    IS_OCCUPIED,
    MOVING,
    NOTHING,
    NOWHERE,
    READY,
    SINGLE,
    STOPPED,
    WAITING,
    WAYS,
    Batch,
)
from railctl.common.rail.compiled.malfunctions import duration, is_struck
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING

UNKNOWN, PASSES, STAYS = range(3)


@bare_kernel
def leave(codes: NDArray[np.int32], leads: NDArray[np.int32], here: int, action: int) -> int:
    """The configuration that an action leads to, NOTHING if the action is none here."""
    code = int(codes[here])
    heading = here & 3
    way = heading
    if code & SINGLE:
        way = code >> AHEAD_SHIFT & 3  # a train faces the way that it came
    elif action == MOVE_LEFT and code >> ((heading + 3) & 3) & 1:
        way = (heading + 3) & 3
    elif action == MOVE_RIGHT and code >> ((heading + 1) & 3) & 1:
        way = (heading + 1) & 3
    elif not code >> heading & 1:
        return NOTHING
    to = int(leads[(here & ~3) + way])
    return to if codes[to] & WAYS else NOTHING


@bare_kernel
def destination(codes: NDArray[np.int32], leads: NDArray[np.int32], train: np.void, action: int) -> int:
    """Where a move leads a train: off the map to where it starts; NOTHING if there is no such move."""
    return int(train["start"]) if train["config"] == NOWHERE else leave(codes, leads, int(train["config"]), action)


@bare_kernel
def start(batch: Batch, slot: int, legacy: bool) -> None:
    """Put the trains of a slot where an episode begins."""
    world, cells = batch.worlds[slot], batch.cells[slot]
    world["time"] = 0
    world["over"] = False
    world["all_arrived"] = False
    for at in range(world["trains"]):
        train = batch.trains[slot, at]
        train["state"] = READY if legacy else WAITING
        train["config"] = NOWHERE
        train["finish"] = NOWHERE
        train["speed"] = train["full_speed"]
        train["distance"] = 0
        train["malfunction"] = 0
        train["arrived_at"] = NOTHING
        train["stood"] = 0
        train["done"] = False
        train["stuck"] = False
        train["bound"] = NOTHING
        train["committed"] = NOTHING
        train["driving"] = False
        cells[train["start"] >> 2]["waiting"] += 1


@bare_kernel
def step(batch: Batch, slot: int, legacy: bool) -> None:
    """One step of a world that is not over, with the actions that its trains hold."""
    world, cells = batch.worlds[slot], batch.cells[slot]
    trains = batch.trains[slot, : world["trains"]]
    codes, leads = batch.codes[slot], batch.leads[slot]
    time, unit = world["time"] + 1, world["unit"]
    world["time"] = time
    if world["breaks"]:
        break_down(world, trains, batch.uniforms[slot], batch.later[slot], batch.known[slot])
    for at in range(len(trains)):
        if legacy:
            remember(codes, leads, trains[at])
        intend(codes, leads, trains[at], unit, time)
    resolve(trains, cells)
    all_arrived = True
    for at in range(len(trains)):
        act(trains[at], unit, time)
        all_arrived = all_arrived and trains[at]["state"] == DONE
    settle(codes, trains, cells, time)
    over = all_arrived or time >= world["max_steps"]
    world["all_arrived"] = all_arrived
    world["over"] = over
    for at in range(len(trains)):
        train = trains[at]
        if over:
            train["done"] = True
        if legacy:
            blocked = train["driving"] and train["config"] == train["before"]
            train["committed"] = train["action"] if blocked else NOTHING


@bare_kernel
def break_down(
    world: np.void,
    trains: NDArray[np.void],
    uniforms: NDArray[np.uint32],
    later: NDArray[np.uint32],
    known: NDArray[np.uint32],
) -> None:
    """Draw malfunctions for all trains, also those that cannot break (any more, or once more)."""
    for at in range(len(trains)):
        if is_struck(world, uniforms, known):
            steps = duration(world, later, known)
            if trains[at]["malfunction"] == 0:
                trains[at]["malfunction"] = steps


@bare_kernel
def remember(codes: NDArray[np.int32], leads: NDArray[np.int32], train: np.void) -> None:
    """Replace a train's action by what 4.3.0 must be told to do as 2.2.2 does; note whether the train is driving."""
    here = int(train["config"])
    if here == NOWHERE:
        train["driving"] = False
        return
    if train["committed"] != NOTHING:
        train["action"] = train["committed"]
    elif train["action"] == DO_NOTHING:
        train["action"] = MOVE_FORWARD if train["driving"] else STOP_MOVING
    action = int(train["action"])
    train["driving"] = action != STOP_MOVING and leave(codes, leads, here, action) != NOTHING


@bare_kernel
def intend(codes: NDArray[np.int32], leads: NDArray[np.int32], train: np.void, unit: int, time: int) -> None:
    """Where a train wants to be after this step, and how fast, if nobody hinders it."""
    state, action, broken = train["state"], train["action"], train["malfunction"] > 0
    config = int(train["config"])
    train["before"] = config
    here = int(train["start"]) if config == NOWHERE else config
    to = leave(codes, leads, here, action)
    valid = to != NOTHING
    moves = MOVE_LEFT <= action <= MOVE_RIGHT
    speed = int(train["speed"])
    if not valid:
        speed = 0
    elif (moves and state in (STOPPED, BROKEN)) or (action == MOVE_FORWARD and (to ^ here) & 1 == 0):
        speed += unit
    elif action == STOP_MOVING:
        speed -= unit
    speed = max(0, min(int(train["full_speed"]), speed))
    want = NOWHERE
    if state == READY:
        if moves and valid:
            want = here
    elif state == BROKEN_OFF_MAP:
        if not broken and train["departure"] <= time and valid and (moves or action == STOP_MOVING):
            want = here
    elif state in (MOVING, STOPPED, BROKEN):
        want = here
        if not broken and train["distance"] + speed >= unit:
            drives_on = state == MOVING and (speed > 0 or (valid and action != STOP_MOVING))
            if drives_on or (state != MOVING and moves and valid):
                want = to
    train["want"] = want
    train["next_speed"] = speed
    train["valid"] = valid


@bare_kernel
def resolve(trains: NDArray[np.void], cells: NDArray[np.void]) -> None:
    """Who may go where it wants to: the lowest train, if it swaps with nobody and who is there goes on itself."""
    for at in range(len(trains)):
        want = int(trains[at]["want"])
        if want == NOWHERE or want >> 2 == trains[at]["before"] >> 2:
            trains[at]["passes"] = STAYS
        else:
            trains[at]["passes"] = UNKNOWN
            if cells[want >> 2]["claim"] == NOTHING:
                cells[want >> 2]["claim"] = at
    for at in range(len(trains)):
        if trains[at]["passes"] != UNKNOWN:
            continue
        last, answer = at, UNKNOWN
        while answer == UNKNOWN:  # follow those in the way; whoever is met again closes a ring, which moves
            here, there = int(trains[last]["before"]), int(trains[last]["want"]) >> 2
            ahead = int(cells[there]["train"])
            trains[last]["passes"] = PASSES
            if cells[there]["claim"] != last:
                answer = STAYS
            elif ahead == NOTHING:
                answer = PASSES
            elif here != NOWHERE and trains[ahead]["want"] >> 2 == here >> 2:
                answer = STAYS
            else:
                answer = int(trains[ahead]["passes"])
                last = ahead if answer == UNKNOWN else last
        if answer == STAYS:
            follower = at
            while True:
                trains[follower]["passes"] = STAYS
                if follower == last:
                    break
                follower = int(cells[trains[follower]["want"] >> 2]["train"])
    for at in range(len(trains)):
        if trains[at]["want"] != NOWHERE:
            cells[trains[at]["want"] >> 2]["claim"] = NOTHING


@bare_kernel
def act(train: np.void, unit: int, time: int) -> None:
    """The state machine of a train, then its position, speed and malfunction."""
    state, action, broken = int(train["state"]), train["action"], train["malfunction"] > 0
    moves = MOVE_LEFT <= action <= MOVE_RIGHT
    on_map = state in (MOVING, STOPPED, BROKEN)
    allowed = train["valid"] and (
        train["passes"] == PASSES or (on_map and train["distance"] + train["next_speed"] < unit)
    )
    now = state
    if state == WAITING:
        now = BROKEN_OFF_MAP if broken else READY if time >= train["departure"] else WAITING
    elif state == READY:
        now = BROKEN_OFF_MAP if broken else MOVING if moves and allowed else READY
    elif state == BROKEN_OFF_MAP:
        if broken:
            now = BROKEN_OFF_MAP
        elif time < train["departure"]:
            now = WAITING
        elif moves and allowed:
            now = MOVING
        else:
            now = STOPPED if action == STOP_MOVING and allowed else READY
    elif state == MOVING:
        stops = (action == STOP_MOVING and train["next_speed"] == 0) or not allowed
        now = BROKEN if broken else STOPPED if stops else MOVING
    elif state in (STOPPED, BROKEN):
        now = BROKEN if broken else MOVING if moves and allowed else STOPPED
    if now == MOVING:
        train["config"] = train["want"]
        if on_map:
            train["speed"] = train["next_speed"]
            train["distance"] = (train["distance"] + train["speed"]) % unit
        if train["config"] >> 2 == train["target"] and train["target_ways"] >> (train["config"] & 3) & 1:
            now = DONE
            train["finish"] = train["config"]
            train["config"] = NOWHERE
            train["arrived_at"] = time
            train["done"] = True
    elif state == BROKEN_OFF_MAP and now == STOPPED:
        train["config"] = train["start"]
    if now in (STOPPED, BROKEN):
        train["speed"] = 0
    train["state"] = now
    train["stood"] = 0 if now in (WAITING, MOVING, DONE) else train["stood"] + 1
    if train["malfunction"] > 0:
        train["malfunction"] -= 1


@bare_kernel
def settle(codes: NDArray[np.int32], trains: NDArray[np.void], cells: NDArray[np.void], time: int) -> None:
    """Note in the cells, and the codes, who is where now."""
    for at in range(len(trains)):
        if trains[at]["before"] != NOWHERE:
            cell = trains[at]["before"] >> 2
            cells[cell]["train"] = NOTHING
            for here in range(cell * 4, cell * 4 + 4):
                codes[here] &= ~IS_OCCUPIED
        elif trains[at]["config"] != NOWHERE or trains[at]["arrived_at"] == time:
            cells[trains[at]["start"] >> 2]["waiting"] -= 1
    for at in range(len(trains)):
        if trains[at]["config"] != NOWHERE:
            cell = trains[at]["config"] >> 2
            cells[cell]["train"] = at
            for here in range(cell * 4, cell * 4 + 4):
                codes[here] |= IS_OCCUPIED
