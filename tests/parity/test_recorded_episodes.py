"""Episodes recorded with flatland-rl 2.2.2 replay without a difference: compiled, and on flatland-rl 4.3.0."""

from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels.files import opened
from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.rail.flatland_world import FlatlandEpisode
from railctl.tools.recordings.findings import FIELDS, Findings
from railctl.tools.recordings.recorded import (
    ACTIVE,
    ARRIVED,
    READY_TO_DEPART,
    Course,
    RecordedEpisode,
    episode_names,
    read_episode,
)
from railctl.tools.recordings.replay import replay

HERE = Path(__file__).parent
SMALL = HERE / "data" / "flatland222_episodes_small.npz"
FULL = HERE.parents[2] / "shared" / "data" / "flatland222_episodes.npz"  # where the small file was cut from, if there


def episodes(path: Path) -> list[RecordedEpisode]:
    with opened(path) as arrays:
        return [read_episode(path, arrays, name) for name in episode_names(path, arrays)]


EPISODES = [
    pytest.param(told, id=f"{path.stem}-{told.name}")
    for path in (SMALL, FULL)
    if path.exists()
    for told in episodes(path)
]


def replay_on_flatland(told: RecordedEpisode) -> Course:
    """As `tools.recordings.replay.replay`, for episodes that end no earlier than their recording."""
    episode, observations = FlatlandEpisode(told.level), len(told.course.tree)
    ours: dict[str, list] = {name: [] for name in FIELDS}
    ours["tree"].append(trees(episode))
    for actions in told.actions.tolist():
        assert not episode.over
        ours["reward"].append(episode.step(actions))
        places = episode.configurations()
        ours["position"].append([(-1, -1, -1) if here is None else here for here in places])
        arrived, committed = episode.arrived(), episode.committed()
        ours["status"].append(
            [
                ARRIVED if done else READY_TO_DEPART if here is None else ACTIVE
                for done, here in zip(arrived, places, strict=True)
            ]
        )
        ours["required"].append([not (done or bound) for done, bound in zip(arrived, committed, strict=True)])
        if len(ours["tree"]) < observations:
            ours["tree"].append(trees(episode))
    return Course(**{name: np.array(rows) for name, rows in ours.items()}, ended=episode.over)


def trees(episode: FlatlandEpisode) -> list[np.ndarray]:
    unseen = np.full((21, 12), np.nan, np.float32)
    return [unseen if arrived else episode.tree(train) for train, arrived in enumerate(episode.arrived())]


@pytest.mark.parametrize("engine", [replay, replay_on_flatland])
@pytest.mark.parametrize("told", EPISODES)
def test_a_recorded_episode_replays(told: RecordedEpisode, engine):
    findings = Findings()
    findings.add(told, engine(told))
    assert findings.agent_steps == told.actions.size > 0
    assert findings.tree_nodes > 0
    assert findings.first_mismatch is None
    assert set(findings.mismatches.values()) == {0}


@pytest.mark.parametrize(("n_trains", "max_steps", "observations"), [(1, 90, 91), (2, 60, 1), (7, 120, 25)])
def test_what_flatland_plays_on_levels_of_other_sizes_replays(n_trains: int, max_steps: int, observations: int):
    level = generate("hard", 30 + n_trains)
    grid = np.pad(level.grid, ((0, 3), (0, 9)))
    level = Level(grid, level.starts[:n_trains], level.targets[:n_trains], max_steps)
    rng = np.random.default_rng(n_trains)
    actions = rng.choice(5, p=[0.05, 0.1, 0.7, 0.1, 0.05], size=(max_steps, n_trains)).astype(np.int8)
    blank = Course(*[np.zeros(0)] * 4, np.empty((observations, n_trains, 21, 12), np.float32), None)
    told = RecordedEpisode("other", level, actions, blank)
    told = told._replace(course=replay_on_flatland(told))
    findings = Findings()
    findings.add(told, replay(told))
    assert findings.first_mismatch is None
    assert (told.course.position >= 0).any()
