"""Replaying recorded episodes of flatland 2.2.2 on the compiled world."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from railctl.common.levels.files import LevelFileError, opened
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.tools.recordings.findings import Findings
from railctl.tools.recordings.recorded import (
    ACTIVE,
    ARRIVED,
    DEPTHS,
    READY_TO_DEPART,
    Course,
    RecordedEpisode,
    episode_names,
    read_episode,
)

AFTER_THE_END = 1.0  # what 2.2.2 rewards every train with in a step after the last


def replay_file(path: Path, on_episode: Callable[[int, int], None] = lambda _done, _total: None) -> Findings:
    """Replay all episodes of a file.

    Args:
        path: of the file, see `tools.recordings.recorded`.
        on_episode: told the number of episodes that have been replayed, and of all; first before the first.

    Raises:
        LevelFileError: the file holds no recordings, or one that cannot be.
    """
    findings = Findings()
    with opened(path) as arrays:
        names = episode_names(path, arrays)
        on_episode(0, len(names))
        for name in names:
            told = read_episode(path, arrays, name)
            try:
                ours = replay(told)
            except ValueError as error:
                raise LevelFileError(f"{path}: episode {name}: {error}: correct {name}_grid or _agents") from None
            findings.add(told, ours)
            on_episode(findings.episodes, len(names))
    return findings


def replay(told: RecordedEpisode) -> Course:
    """What comes of a recorded episode's level and actions on the compiled world; as many trees as were recorded.

    Raises:
        ValueError: the level is none that the world can load.
    """
    n_steps, n_trains = told.actions.shape
    world, depth = CompiledWorld(1, n_trains, decisions="legacy"), DEPTHS[told.course.tree.shape[2]]
    world.load(0, told.level)
    trains, cells = world.batch.trains[0], world.batch.cells[0]
    position = np.empty((n_steps, n_trains, 3), np.int32)
    reward = np.empty((n_steps, n_trains), np.float32)
    status = np.empty((n_steps, n_trains), np.uint8)
    required = np.zeros((n_steps, n_trains), np.bool_)
    tree = np.empty(told.course.tree.shape, np.float32)
    for step in range(n_steps + 1):
        if step < len(tree):
            world.trees(tree[step : step + 1], depth=depth)
        if step == n_steps:
            break
        had_ended = world.over()[0]
        rewards = world.obey(told.actions[step : step + 1])[0]
        reward[step] = AFTER_THE_END if had_ended else rewards
        config, arrived = trains["config"], trains["state"] == DONE
        here = cells[config >> 2]
        position[step] = np.column_stack([here["row"], here["column"], config & 3])
        position[step, config == NOWHERE] = -1
        status[step] = np.where(arrived, ARRIVED, np.where(config == NOWHERE, READY_TO_DEPART, ACTIVE))
        if not had_ended:
            required[step] = ~arrived & (trains["committed"] == NOTHING)
    return Course(position, reward, status, required, tree, ended=bool(world.over()[0]))
