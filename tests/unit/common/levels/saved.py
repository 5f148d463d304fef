"""Files as flatland-rl's versions saved them, written without those versions: a track with a branch, and two trains."""

import io
import pickle
from typing import Any

import numpy as np
from msgpack._cmsgpack import Packer

from railctl.common.levels.level import Level

AGENT, STATES, STEP = "flatland.envs.agent_utils", "flatland.envs.step_utils.states", "flatland.envs.step_utils"
WEST_END, ALONG, SWITCH, EAST_END, NORTH_END = 0x0004, 0x0401, 0x0C11, 0x0100, 0x2000
GRID = [[0, 0, NORTH_END, 0, 0, 0], [WEST_END, ALONG, SWITCH, ALONG, ALONG, EAST_END]]
STARTS, TARGETS = [((1, 1), 1), ((1, 3), 3)], [(1, 5), (0, 2)]  # row, column, heading; row, column
LEVEL = Level(
    grid=np.array(GRID, np.uint16),
    starts=np.array([(*cell, heading) for cell, heading in STARTS], np.int32),
    targets=np.array(TARGETS, np.int32),
    max_steps=72,  # int(8 x (2 + 6 + 2 / 2))
)


class Saved:
    """An object of a class that need not be there."""

    def __init__(self, name: str, *arguments: Any, state: Any = None) -> None:
        self.name = name
        self.arguments = arguments
        self.state = state


class _Writer(pickle._Pickler):
    dispatch = dict(pickle._Pickler.dispatch)  # noqa: RUF012

    def save_saved(self, saved: Saved) -> None:
        module, _, name = saved.name.rpartition(".")
        self.write(pickle.GLOBAL + f"{module}\n{name}\n".encode())
        self.save(saved.arguments)
        self.write(pickle.NEWOBJ)
        if saved.state is not None:
            self.save(saved.state)
            self.write(pickle.BUILD)

    dispatch[Saved] = save_saved


def pickled(content: Any, protocol: int = 4) -> bytes:
    file = io.BytesIO()
    _Writer(file, protocol).dump(content)
    return file.getvalue()


def packed(content: Any, *, use_bin_type: bool = True) -> bytes:
    return bytes(Packer(default=_numpy, use_bin_type=use_bin_type).pack(content))


def _numpy(value: Any) -> Any:
    """As msgpack-numpy packs numpy's arrays and numbers."""
    if isinstance(value, np.ndarray):
        return {b"nd": True, b"type": value.dtype.str, b"kind": b"", b"shape": value.shape, b"data": value.tobytes()}
    return {b"nd": False, b"type": value.dtype.str, b"data": value.tobytes()}


def speed_data(speed: float) -> dict[str, Any]:
    return {"position_fraction": 0.0, "speed": speed, "transition_action_on_cellexit": 0}


def malfunction_data(rate: float = 0, steps: int = 0) -> dict[str, Any]:
    return {"malfunction": steps, "malfunction_rate": rate, "next_malfunction": 0, "nr_malfunctions": 0}


def static(fields: int, speeds: tuple[float, float] = (1.0, 0.5), rate: float = 0) -> dict[str, Any]:
    """2.0 and the editor: trains of 3 to 6 fields."""
    trains = [
        [cell, heading, target, 0, speed_data(speed), malfunction_data(rate)][:fields]
        for (cell, heading), target, speed in zip(STARTS, TARGETS, speeds, strict=True)
    ]
    return {"grid": GRID, "agents_static": trains, "agents": []}


def second(
    speeds: tuple[float, float] = (1.0, 0.5), position: Any = None, status: Any = 0, **content: Any
) -> dict[str, Any]:
    """2.1.10 and 2.2: tuples of 12 fields."""
    trains = [
        (cell, heading, heading, target, False, speed_data(speed), malfunction_data(), at, status, position, None, None)
        for at, ((cell, heading), target, speed) in enumerate(zip(STARTS, TARGETS, speeds, strict=True))
    ]
    return {"grid": GRID, "agents": trains, "malfunction": (0.0, 0, 0), "max_episode_steps": 90} | content


def between(speeds: tuple[float, float] = (1.0, 0.5)) -> dict[str, Any]:
    """On the way from 2.2 to 3: 15 fields, with windows."""
    trains = []
    for at, train in enumerate(second(speeds)["agents"]):
        windows = (at, 40 + at)
        trains.append((*train[:5], *windows, *train[5:8], 0, None, None, None, None))
    return second() | {"agents": trains}


def third(speeds: tuple[Any, Any] = (1.0, 0.33), state: int = 0, **content: Any) -> dict[str, Any]:
    """3.0: named tuples of 16 fields, the last of them objects."""
    trains = []
    for at, ((cell, heading), target, speed) in enumerate(zip(STARTS, TARGETS, speeds, strict=True)):
        machine = {"_initial_state": Saved(f"{STATES}.TrainState", 0), "_state": Saved(f"{STATES}.TrainState", state)}
        objects = (
            Saved(f"{STEP}.speed_counter.SpeedCounter", state={"_speed": speed, "counter": 0}),
            Saved(f"{STEP}.action_saver.ActionSaver", state={"saved_action": None}),
            Saved(f"{STEP}.state_machine.TrainStateMachine", state=machine),
            Saved(f"{STEP}.malfunction_handler.MalfunctionHandler", state={"_malfunction_down_counter": 0}),
        )
        fields = cell, heading, heading, target, False, 3 + at, 50 + at, at, None, None, None, None, *objects
        trains.append(Saved(f"{AGENT}.Agent", *fields))
    parameters = Saved("flatland.envs.malfunction_generators.MalfunctionProcessData", 0.0, 20, 50)
    return {"grid": GRID, "agents": trains, "malfunction": parameters, "max_episode_steps": 90} | content


def fourth(group: Any, **content: Any) -> dict[str, Any]:
    """4.0.5 to 4.2.6: as in 3, with waypoints and windows; `group` makes the stops of a train."""
    document = third(**content)
    for train, (cell, heading), target in zip(document["agents"], STARTS, TARGETS, strict=True):
        train.arguments += (group(cell, heading, target), [train.arguments[5], None], [None, train.arguments[6]])
    return document


def waypoint(cell: Any, heading: int | None) -> Saved:
    name = "flatland.envs.rail_trainrun_data_structures.Waypoint"
    return Saved(name, state={"position": cell, "direction": heading})


def effects_in_each_other(depth: int, width: int) -> dict[str, Any]:
    """Each the same that many times: width ** depth to whoever goes through all."""
    effect: dict[str, Any] = {"cls": "flatland.core.effects_generator.EffectsGenerator"}
    for _ in range(depth):
        effect = {"cls": "flatland.core.MultiEffectsGeneratorWrapped", "specs": {"args": [effect] * width}}
    return effect
