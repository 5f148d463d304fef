"""flatland-rl's own files, of all versions since 2.0: what they hold comes along, and what cannot is named."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import saved
from flatland.core.env_observation_builder import DummyObservationBuilder
from flatland.envs.line_generators import sparse_line_generator
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from flatland.envs.persistence import RailEnvPersister
from flatland.envs.rail_env import RailEnv
from flatland.envs.rail_generators import sparse_rail_generator
from flatland.envs.rewards import DefaultRewards
from hypothesis import given, settings
from hypothesis import strategies as st
from saved import LEVEL, Saved, between, fourth, packed, pickled, second, static, third, waypoint

from railctl.common.levels.distributions import MalfunctionSettings, StockLevels
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.flatland.reading import ReadLevel, read_level
from railctl.common.levels.generate import generate
from railctl.common.levels.level import MOST_STEPS, Level, Malfunctions, Schedule
from railctl.common.levels.plain import usable_headings
from railctl.common.levels.reading import read
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.from_flatland import level_of
from railctl.common.rail.plain_env import plain_environment
from railctl.common.rail.world import MOVE_FORWARD
from railctl.tools.levels.export import save_pickle

FORMULA = ["without a step limit: 72 steps are taken, 8 x (rows + columns + trains / 2)"]
RUSH = StockLevels(
    rules="stock",
    size=(26, 30),
    trains=4,
    cities=2,
    speeds={1.0: 0.5, 0.33: 0.5},
    malfunctions=MalfunctionSettings(rate=0.02, min_steps=3, max_steps=9),
)


def read_bytes(folder: Path, data: bytes) -> ReadLevel:
    path = folder / "level.pkl"
    path.write_bytes(data)
    return read_level(path)


def facts(level: Level) -> tuple[list[Any], list[int], list[int]]:
    """Speeds and windows; those of a level without a schedule are the plain ones."""
    if level.schedule is None:
        return [[1, 1]] * level.n_trains, [0] * level.n_trains, [level.max_steps] * level.n_trains
    schedule = level.schedule
    columns = schedule.speeds, schedule.earliest_departures, schedule.latest_arrivals
    return tuple(column.tolist() for column in columns)  # type: ignore[return-value]


HALF = [[1, 1], [1, 2]]
THIRD = [[1, 1], [1, 3]]


@pytest.mark.parametrize(
    ("data", "limit", "speeds", "departures", "arrivals"),
    [
        pytest.param(packed(static(3)), 72, [[1, 1]] * 2, [0, 0], [72, 72], id="2.0, of the editor"),
        pytest.param(packed(static(4)), 72, [[1, 1]] * 2, [0, 0], [72, 72], id="2.0, moving"),
        pytest.param(packed(static(5)), 72, HALF, [0, 0], [72, 72], id="2.0, speeds"),
        pytest.param(packed(static(6)), 72, HALF, [0, 0], [72, 72], id="2.0, malfunctions"),
        pytest.param(packed(static(6), use_bin_type=False), 72, HALF, [0, 0], [72, 72], id="msgpack of old"),
        pytest.param(packed(second()), 90, HALF, [0, 0], [90, 90], id="2.2, msgpack"),
        pytest.param(packed(second(max_episode_steps=None)), 72, HALF, [0, 0], [72, 72], id="2.1.10"),
        pytest.param(pickled(second()), 90, HALF, [0, 0], [90, 90], id="2.2, pickle"),
        pytest.param(pickled(between()), 90, HALF, [0, 1], [40, 41], id="between 2.2 and 3"),
        pytest.param(packed(between()), 90, HALF, [0, 1], [40, 41], id="between 2.2 and 3, msgpack"),
        pytest.param(pickled(third(), 3), 90, THIRD, [3, 4], [50, 51], id="3"),
        pytest.param(pickled(third(max_episode_steps=0)), 72, THIRD, [3, 4], [50, 51], id="3, without a limit"),
        pytest.param(
            pickled(fourth(lambda cell, heading, target: [waypoint(cell, heading), waypoint(target, None)])),
            *(90, THIRD, [3, 4], [50, 51]),
            id="4.0.5",
        ),
        pytest.param(
            pickled(fourth(lambda cell, heading, target: [[waypoint(cell, heading)], [waypoint(target, None)]])),
            *(90, THIRD, [3, 4], [50, 51]),
            id="4.2.6",
        ),
    ],
)
def test_a_level_of_every_version_is_read(tmp_path: Path, data: bytes, limit, speeds, departures, arrivals):
    level = read_bytes(tmp_path, data).level
    assert replace(level, schedule=None).content_hash == replace(LEVEL, max_steps=limit).content_hash
    assert facts(level) == (speeds, departures, arrivals)


def test_what_a_file_is_called_does_not_matter(tmp_path: Path):
    for name in ("level.mpk", "level.pkl", "level", "level.npz.bak"):
        (tmp_path / name).write_bytes(packed(static(3)))
        assert list(read(tmp_path / name).groups) == ["2x6_2_trains"]


@pytest.mark.parametrize("form", [np.uint16, np.int64, ">u2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_grids_are_lists_or_arrays(tmp_path: Path, form: Any, order: Any):
    grid = np.asarray(saved.GRID, form, order=order)
    trains = [
        [tuple(np.array(cell)), np.int64(heading), target]
        for (cell, heading), target in zip(saved.STARTS, saved.TARGETS, strict=True)
    ]
    document = {"grid": grid, "agents_static": trains}
    for data in (packed(document | {"grid": np.ascontiguousarray(grid)}), *(pickled(document, at) for at in (2, 4, 5))):
        assert read_bytes(tmp_path, data).level.content_hash == LEVEL.content_hash


@pytest.mark.parametrize(
    ("speed", "expected"),
    [
        (Saved("fractions.Fraction", "2/5"), [2, 5]),
        (Saved("fractions.Fraction", 2, 5), [2, 5]),  # of Python 3.12
        (Saved("fractions.Fraction", "1"), [1, 1]),
        (np.float64(0.25), [1, 4]),
        (0.3333, [1, 3]),
        (0.7, [7, 10]),
        (1, [1, 1]),
    ],
)
def test_speeds_are_exact(tmp_path: Path, speed: Any, expected: list[int]):
    assert facts(read_bytes(tmp_path, pickled(third((0.5, speed)))).level)[0] == [[1, 2], expected]


def test_plain_files_make_plain_levels(tmp_path: Path):
    assert read_bytes(tmp_path, packed(static(6, (1.0, 1.0)))).level.schedule is None
    assert read_bytes(tmp_path, pickled(second((1.0, 1.0)))).level.schedule is None


def effects(*some: dict[str, Any]) -> dict[str, Any]:
    return {
        "effects_generator": {
            "cls": "flatland.core.effects_generator.MultiEffectsGeneratorWrapped",
            "specs": {"args": list(some)},
        }
    }


BREAKS = {
    "cls": "flatland.envs.malfunction_effects_generators.MalfunctionEffectsGenerator",
    "specs": {
        "kwargs": {"param_malfunction_gen": {"malfunction_rate": 0.25, "min_duration": 2, "max_duration": 5}},
    },
}
RECORDS = {"cls": "flatland.envs.record_steps_effects_generator.RecordStepsEffectsGenerator"}
OTHER = {"cls": "flatland.envs.malfunction_effects_generators.ConditionalMalfunctionEffectsGenerator"}


@pytest.mark.parametrize(
    ("data", "malfunctions", "notes"),
    [
        (
            packed(static(6, rate=30)),
            None,
            [*FORMULA, "left out: malfunction rates of their own of 2 trains, as 2.0 had"],
        ),
        (
            packed(second(malfunction=(80.0, 20, 50))),
            Malfunctions(1 / 80, 20, 50),
            ["a malfunction rate of 80: taken as"],
        ),
        (packed(second(malfunction=(0.5, 20, 50))), Malfunctions(0.5, 20, 50), []),
        (packed(second(position=(1, 2), status=1)), None, ["left out: the state of an episode under way: 2 trains"]),
        (pickled(second(status=3)), None, ["left out: the state of an episode under way: 2 trains had departed"]),
        (pickled(third(state=6)), None, ["left out: the state of an episode under way: 2 trains had departed"]),
        (pickled(third(elapsed_steps=4)), None, ["left out: the state of an episode under way: 4 steps were played"]),
        (pickled(third(actions=[{0: 1}])), None, ["left out: the recorded actions"]),
        (pickled(third(**effects(RECORDS, BREAKS))), Malfunctions(0.25, 2, 5), []),
        (pickled(third(**effects(OTHER))), None, ["left out: effects of ConditionalMalfunctionEffectsGenerator"]),
        (
            pickled(
                fourth(lambda cell, way, target: [waypoint(cell, way), waypoint(cell, way), waypoint(target, None)])
            ),
            None,
            ["left out: intermediate stops of 2 trains"],
        ),
    ],
)
def test_malfunctions_come_along_and_what_cannot_is_named(tmp_path: Path, data: bytes, malfunctions, notes: list[str]):
    found = read_bytes(tmp_path, data)
    assert (found.level.schedule and found.level.schedule.malfunctions) == malfunctions
    assert len(found.left_out) == len(notes)
    assert all(line.startswith(note) and "\n" not in line for line, note in zip(found.left_out, notes, strict=True))


SEVERAL_TARGETS = [[(1, 5), 1], [(0, 2), 0]]


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (pickled(third(level_free_positions={(1, 2)})), "has level-free crossings, which are not supported"),
        (pickled(third((0.5, 2.0))), "a train has a speed of 2.0, which is not above 0 and at most 1"),
        (pickled(third((0.5, 0.0))), "a train has a speed of 0.0, which is not above 0 and at most 1"),
        (pickled(third((0.5, float("nan")))), "a train has a speed of nan, which is not above 0 and at most 1"),
        (pickled(second(malfunction=(0.5, 9, 5))), "has malfunctions of rate 0.5 for 9 to 5 steps"),
        (pickled(third(**effects(BREAKS, BREAKS))), "has several kinds of malfunctions"),
        (
            pickled(fourth(lambda cell, way, _: [[waypoint(cell, way)], [waypoint(*end) for end in SEVERAL_TARGETS]])),
            "a train has targets in several cells, which is not supported",
        ),
        (
            pickled(fourth(lambda cell, way, target: [[waypoint(cell, way)], [waypoint(target, 2)]])),
            "train 0 can have none of the headings that count at its target",
        ),
        (
            packed({"grid": saved.GRID, "agents_static": [[(1, 1), 1, (1, 1)]]}),
            "train 0 stands on its target at the start, row 1, column 1: move one of them",
        ),
        (packed({"grid": saved.GRID, "agents_static": [[(1, 0), 1, (1, 3)]]}), "where no rail leads on for heading 1"),
        (packed({"grid": saved.GRID, "agents": []}), "no trains"),
        (packed({"grid": [[0, 70_000]], "agents": []}), "is not as any version of flatland-rl saves"),
        (packed({"grid": [[0, 0], [0]], "agents": []}), "is not as any version of flatland-rl saves"),
        (pickled([1]), "is not as any version of flatland-rl saves"),
        (b"", "is neither a pickle nor msgpack of flatland-rl"),
        (b"text", "is neither a pickle nor msgpack of flatland-rl"),
    ],
)
def test_what_no_level_can_say_is_refused(tmp_path: Path, data: bytes, problem: str):
    with pytest.raises(LevelFileError) as error:
        read_bytes(tmp_path, data)
    assert str(error.value).startswith(str(tmp_path / "level.pkl"))
    assert problem in str(error.value)
    assert "\n" not in str(error.value)


def test_headings_that_count_are_those_of_the_last_waypoint(tmp_path: Path):
    ends = {(1, 5): 1, (0, 2): 0}
    data = pickled(fourth(lambda cell, way, target: [[waypoint(cell, way)], [waypoint(target, ends[target])]]))
    level = read_bytes(tmp_path, data).level
    assert level.schedule is not None
    assert level.schedule.target_headings.tolist() == [1 << 1, 1 << 0]


def library_environment() -> RailEnv:
    env = RailEnv(
        30,
        28,
        rail_generator=sparse_rail_generator(max_num_cities=2),
        line_generator=sparse_line_generator({1.0: 0.5, 0.33: 0.5}),
        malfunction_generator=ParamMalfunctionGen(MalfunctionParameters(0.05, 3, 9)),
        number_of_agents=4,
        random_seed=1,
    )
    env.reset()
    return env


def test_a_file_of_the_library_gives_its_level_even_from_the_middle_of_an_episode(tmp_path: Path):
    env = library_environment()
    expected = level_of(env)
    path = tmp_path / "env.pkl"
    RailEnvPersister.save(env, path)
    assert read_level(path).left_out == []
    assert read_level(path).level.content_hash == expected.content_hash
    for _ in range(60):
        env.step(dict.fromkeys(range(4), 2))
    RailEnvPersister.save(env, path, save_distance_maps=True)
    found = read_level(path)
    assert found.level.content_hash == expected.content_hash
    assert found.left_out[0].startswith("left out: the state of an episode under way: ")


def test_the_library_has_what_was_exported(tmp_path: Path):
    level = generate(RUSH, 3)
    schedule, path = level.schedule, tmp_path / "level.pkl"
    assert schedule is not None
    save_pickle(path, level)
    env: Any
    env, _ = RailEnvPersister.load_new(path)
    np.testing.assert_array_equal(env.rail.grid, level.grid)
    assert env._max_episode_steps == level.max_steps
    assert [(*a.initial_configuration[0], a.initial_configuration[1]) for a in env.agents] == list(
        map(tuple, level.starts.tolist())
    )
    assert [{cell for cell, _ in a.targets} for a in env.agents] == [{tuple(cell)} for cell in level.targets.tolist()]
    assert [a.speed_counter.max_speed for a in env.agents] == [Fraction(*speed) for speed in schedule.speeds.tolist()]
    assert [a.earliest_departure for a in env.agents] == schedule.earliest_departures.tolist()
    assert [a.latest_arrival for a in env.agents] == schedule.latest_arrivals.tolist()
    assert tuple(env.effects_generator.malfunction_generator.get_process_data()) == schedule.malfunctions
    assert read_level(path).level.content_hash == level.content_hash
    env.reset()  # as some of its tools do
    assert [a.latest_arrival for a in env.agents] == schedule.latest_arrivals.tolist()
    assert [a.speed_counter.max_speed for a in env.agents] == [Fraction(*speed) for speed in schedule.speeds.tolist()]


@pytest.mark.parametrize("seed", range(3))
def test_a_file_plays_the_same_here_and_in_the_library(tmp_path: Path, seed: int):
    path = tmp_path / "level.pkl"
    save_pickle(path, generate(RUSH.model_copy(update={"malfunctions": None}), seed))
    level = read_level(path).level
    env: Any
    env, _ = RailEnvPersister.load_new(path)
    world = CompiledWorld(1, level.n_trains, rules="stock", decisions="always")
    world.load(0, level)
    rng, paid = np.random.default_rng(seed), np.zeros(level.n_trains)
    while not world.over()[0]:
        wanted = rng.choice(5, p=[0.1, 0.1, 0.6, 0.1, 0.1], size=(1, level.n_trains)).astype(np.int8)
        actions = np.where(world.deciding()[0], wanted[0], MOVE_FORWARD).tolist()
        world.step(wanted)
        _, rewards, dones, _ = env.step(dict(enumerate(actions)))
        paid += list(rewards.values())
        assert world.arrived()[0].tolist() == [agent.arrival_time is not None for agent in env.agents]
        assert dones["__all__"] == world.over()[0]
    score = DefaultRewards().normalize(*paid, num_agents=level.n_trains, max_episode_steps=level.max_steps)
    assert world.score(0) == pytest.approx(score, abs=1e-12)


def played(level: Level, action: int) -> tuple[list[int], list[int]]:
    """When trains arrive in the library and in the compiled world, all doing the same for four steps."""
    env: Any = plain_environment(level, DummyObservationBuilder())  # type: ignore[no-untyped-call]
    env.reset()
    world = CompiledWorld(1, level.n_trains, rules="stock", decisions="always")
    world.load(0, level)
    for _ in range(4):
        world.step(np.full((1, level.n_trains), action, np.int8))
        env.step(dict.fromkeys(range(level.n_trains), action))
    times = [-1 if agent.arrival_time is None else agent.arrival_time for agent in env.agents]
    return times, world.batch.trains[0]["arrived_at"][: level.n_trains].tolist()


@pytest.mark.parametrize(("action", "arrives"), [(2, 2), (0, -1), (4, -1)])
def test_a_train_on_its_target_arrives_as_it_departs_and_no_sooner(action: int, arrives: int):
    level = replace(LEVEL, targets=np.array([(1, 1), (0, 2)], np.int32))
    library, compiled = played(level, action)
    assert library == compiled
    assert library[0] == arrives  # step 1 makes it ready, in step 2 it enters its cell


BOUNDED = st.integers(0, 2**31 - 1)
SPEEDS = st.tuples(st.integers(1, 12), st.integers(1, 12)).filter(lambda pair: pair[0] <= pair[1])


@st.composite
def schedules(draw: st.DrawFn) -> Schedule:
    usable = usable_headings(LEVEL).tolist()
    speeds = [Fraction(*draw(SPEEDS)).as_integer_ratio() for _ in range(2)]
    steps = draw(st.tuples(st.integers(0, 50), st.integers(0, 50)).map(sorted))
    rate = draw(st.floats(1e-6, 1))
    return Schedule(
        speeds=np.array(speeds, np.int32),
        earliest_departures=np.array(draw(st.tuples(*[st.integers(0, 10**8)] * 2)), np.int32),
        latest_arrivals=np.array(draw(st.tuples(BOUNDED, BOUNDED)), np.int32),
        target_headings=np.array(
            [draw(st.sampled_from([ways for ways in range(1, 16) if ways & of == ways])) for of in usable], np.int32
        ),
        malfunctions=draw(st.sampled_from([None, Malfunctions(rate, *steps)])),
    )


@settings(max_examples=25, deadline=None)
@given(schedules(), st.integers(1, MOST_STEPS))
def test_any_schedule_goes_out_and_comes_back(tmp_path_factory: pytest.TempPathFactory, schedule: Schedule, limit: int):
    level = replace(LEVEL, schedule=schedule, max_steps=limit)
    path = tmp_path_factory.mktemp("level") / "level.pkl"
    save_pickle(path, level)
    back = read_level(path)
    assert back.left_out == []
    assert back.level.content_hash == level.content_hash
