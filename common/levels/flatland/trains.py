"""A train out of flatland-rl's own files.

What the versions keep of one, by position:
- `agents_static` (2.0 and the editor): start, heading, target, moving, speed data, malfunction data; the last may lack.
- 2.1 and 2.2: start, heading, heading now, target, moving, speed data, malfunction data, handle, status, position, ...
- 3 and 4: start, heading, heading now, target(s), moving, earliest departure, latest arrival, handle, position, arrival
  time, headings and position before, `SpeedCounter`, action saver, state machine, malfunction handler, since 4.0.5
  waypoints and windows. Early ones have speed data, malfunction data, handle and status where later ones have a handle.

Source: `EnvAgent.to_list`, `Agent` and `load_env_agent` in `flatland/envs/agent_utils.py` of all versions.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from railctl.common.levels.files import LARGEST_SIDE, LATEST, LevelFileError
from railctl.common.levels.flatland.inert import NotPlainError, Stub, number, sequence, whole
from railctl.common.levels.speeds import speed_fraction

MOST_FIELDS = 100
MOST_ENDS = 64  # cells and headings at which a train may arrive
MOST_STOPS = 10_000
NEVER = 2**31 - 1  # stands for all that is later: 3 and 4 write 2**63 - 1 for trains without a latest arrival
WAYPOINTS = 16  # their place among the fields of 4
WAITING = (0, 1)  # the states WAITING and READY_TO_DEPART of 3 and 4


@dataclass(frozen=True)
class Train:
    """What a file says of a train.

    Attributes:
        start: row, column, heading.
        target: row, column.
        headings: a bit for each heading that counts at the target; 0: all that the rails allow.
        speed: cells a step.
        departure: the earliest.
        arrival: the latest; None: there is no timetable.
        is_on_its_way: it has departed, or arrived.
        breaks_down: at a rate of its own, as in 2.0.
        is_broken: in a malfunction.
        has_stops: between start and target.
    """

    start: tuple[int, int, int]
    target: tuple[int, int]
    headings: int = 0
    speed: Fraction = Fraction(1)
    departure: int = 0
    arrival: int | None = None
    is_on_its_way: bool = False
    breaks_down: bool = False
    is_broken: bool = False
    has_stops: bool = False


def cell(value: Any) -> tuple[int, int]:
    """Row and column."""
    row, column = sequence(value, 2)
    return whole(row, most=LARGEST_SIDE), whole(column, most=LARGEST_SIDE)


def static_train(train: Any) -> Train:
    """Of `agents_static`."""
    fields = sequence(train, MOST_FIELDS)
    return Train(
        start=(*cell(fields[0]), whole(fields[1])),
        target=cell(fields[2]),
        speed=_speed(fields[4] if len(fields) > 4 else None),
        breaks_down=_entry(fields[5:6], "malfunction_rate") > 0,
        is_broken=_entry(fields[5:6], "malfunction") > 0,
    )


def train_of(train: Any) -> Train:
    """Of `agents`."""
    fields = list(train.arguments) if isinstance(train, Stub) else sequence(train, MOST_FIELDS)
    start = (*cell(fields[0]), whole(fields[1]))
    if isinstance(fields[5], dict):  # 2.1 and 2.2
        target, headings = _target(fields[3])
        return Train(
            start,
            target,
            headings,
            speed=_speed(fields[5]),
            is_on_its_way=fields[9] is not None or whole(fields[8]) > 0,
            breaks_down=_entry(fields[6:7], "malfunction_rate") > 0,
            is_broken=_entry(fields[6:7], "malfunction") > 0,
        )
    waypoints = fields[WAYPOINTS] if len(fields) > WAYPOINTS else None
    stops = [] if waypoints is None else sequence(waypoints, MOST_STOPS)
    target, headings = _target(_ends(stops[-1]) if stops else fields[3])
    departure, arrival = fields[5], fields[6]
    handler = next((field for field in fields if _is(field, "MalfunctionHandler")), None)
    return Train(
        start,
        target,
        headings,
        speed=_speed(next((field for field in fields[7:] if _is(field, "SpeedCounter") or _is_speed(field)), None)),
        departure=0 if departure is None else whole(departure, 0, LATEST),
        arrival=None if arrival is None else min(whole(arrival, 0), NEVER),
        is_on_its_way=fields[11 if isinstance(fields[7], dict) else 8] is not None or _has_left(fields),
        is_broken=_entry([handler and handler.state], "_malfunction_down_counter") > 0,
        has_stops=len(stops) > 2,
    )


def _is(field: Any, name: str) -> bool:
    return isinstance(field, Stub) and field.is_called == name


def _is_speed(field: Any) -> bool:
    return isinstance(field, dict) and "speed" in field


def _has_left(fields: list[Any]) -> bool:
    machine = next((field for field in fields if _is(field, "TrainStateMachine")), None)
    state = machine.state.get("_state") if machine is not None and isinstance(machine.state, dict) else None
    return state is not None and whole(state) not in WAITING


def _entry(fields: list[Any], name: str) -> int | float | Fraction:
    """Of a dictionary, 0 if there is none."""
    there = fields[0] if fields else None
    return number(there[name]) if isinstance(there, dict) and there.get(name) is not None else 0


def _speed(data: Any) -> Fraction:
    """Out of speed data or a `SpeedCounter`; 1 if there is none."""
    if data is None:
        return Fraction(1)
    state = data.state if isinstance(data, Stub) else data
    if not isinstance(state, dict):
        raise NotPlainError("a speed that is none")
    for name in ("max_speed", "_max_speed", "_speed", "speed"):
        if state.get(name) is not None:
            value = number(state[name])
            try:
                speed = speed_fraction(value)
            except (ValueError, OverflowError, ZeroDivisionError):
                speed = Fraction(0)
            if not 0 < speed <= 1 or speed.denominator >= 2**31:
                raise LevelFileError(f"a train has a speed of {value!s:.20}, which is not above 0 and at most 1")
            return speed
    raise NotPlainError("a speed that is none")


def _ends(stop: Any) -> list[tuple[Any, Any]]:
    """Cells and headings of a waypoint, or of several that a train may choose from."""
    choice = [stop] if _is(stop, "Waypoint") else sequence(stop, MOST_ENDS)
    if not all(_is(end, "Waypoint") for end in choice):
        raise NotPlainError("waypoints that are none")
    ends = [end.arguments or end.state for end in choice]  # a named tuple, since 4.0.5 a class with slots
    return [(end["position"], end["direction"]) if isinstance(end, dict) else (end[0], end[1]) for end in ends]


def _target(targets: Any) -> tuple[tuple[int, int], int]:
    """The cell of a target and its headings: a cell alone before 4.3, since then all cells and headings that count."""
    found = sequence(targets, MOST_ENDS)
    if not any(isinstance(part, tuple | list) for part in found):
        return cell(targets), 0
    ends = []
    for end in found:
        place, heading = sequence(end, 2)
        ends.append((cell(place), None if heading is None else whole(heading, 0, 3)))
    if len({place for place, _ in ends}) != 1:
        raise LevelFileError("a train has targets in several cells, which is not supported")
    headings = {heading for _, heading in ends}
    return ends[0][0], 0 if None in headings else sum(1 << heading for heading in headings if heading is not None)
