"""Episodes written down for looking at: they are the evaluator's own, and the document says what happened in them."""

import json

import numpy as np
import pytest
from made_rails import scheduled

from railctl.common.checkpoint import OURS, load, save
from railctl.common.levels import files
from railctl.common.levels.level import Malfunctions
from railctl.common.levels.supply import LevelSupply
from railctl.common.playback import ARRIVED, BROKEN, JAMMED, LATE, WAITING, Playback
from railctl.common.requests import LevelChoice, PlaybackRequest, ReferenceRequest, ScoreRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.common.strict import ConfigError
from railctl.deploy.runs import PRETRAINED
from railctl.services.evaluator.playback import play_back
from railctl.services.evaluator.references.__main__ import score as score_reference
from railctl.services.evaluator.runner import UnplayableLevelError
from railctl.services.evaluator.score import score

SUPPLY = LevelSupply()
NETWORKS = {
    "values": NetworkConfig(kind="dueling"),
    "policy": NetworkConfig(kind="actor-critic"),
    "recurrent": NetworkConfig(kind="recurrent"),
}
HARD = LevelChoice(names=("hard",), episodes=3)


@pytest.fixture
def returns_of(capsys):
    """The returns that are printed for this request to score a policy."""

    def run(request):
        (score if isinstance(request, ScoreRequest) else score_reference)(request)
        return json.loads(capsys.readouterr().out.splitlines()[-1])["rows"][0]["returns"]

    return run


@pytest.fixture
def play(tmp_path):
    """The document of this request."""

    def run(levels=HARD, number=0, **asked):
        path = tmp_path / "episode.json"
        choice = levels.model_copy(update={"episodes": None})
        play_back(PlaybackRequest(levels=choice, number=number, file=path, **asked))
        return Playback.model_validate_json(path.read_text())

    return run


@pytest.fixture
def timetabled(tmp_path):
    """Levels with slow trains, which break down and are late."""
    levels = [
        scheduled(
            SUPPLY.evaluation("hard", index),
            speeds=[(1, 1 + train % 3) for train in range(7)],
            arrivals=[20 + 10 * train for train in range(7)],
            malfunctions=Malfunctions(0.05, 2, 6),
        )
        for index in range(3)
    ]
    files.save(tmp_path / "levels.npz", {"rush": levels})
    return LevelChoice(file=tmp_path / "levels.npz")


@pytest.mark.parametrize(
    ("kind", "mode"), [("values", None), ("recurrent", None), ("policy", "greedy"), ("policy", "sample")]
)
def test_a_network_comes_to_the_return_that_the_evaluator_has(
    write_checkpoint, tmp_path, returns_of, play, kind, mode, timetabled
):
    path = write_checkpoint(tmp_path / "weights.safetensors", NETWORKS[kind], seed=4)
    for levels in (HARD, timetabled):
        expected = returns_of(ScoreRequest(checkpoint=path, mode=mode, levels=levels))
        for number in range(3):
            played = play(levels, number, checkpoint=path, mode=mode)
            assert played.result.normalised_return == expected[number]
            assert {decision.scores_are for decision in played.decisions} == {
                "probabilities" if kind == "policy" else "action values"
            }


def test_draws_are_those_of_the_level(write_checkpoint, tmp_path, returns_of, play):
    path = write_checkpoint(tmp_path / "weights.safetensors", NETWORKS["policy"], seed=4)
    for draws in (1, 2):
        expected = returns_of(ScoreRequest(checkpoint=path, mode="sample", draws=draws, levels=HARD))
        assert play(number=2, checkpoint=path, mode="sample", draws=draws).result.normalised_return == expected[2]


def test_the_dispatcher_is_asked_in_the_order_of_its_interlocking(returns_of, play):
    path = PRETRAINED / "dispatch-hard.safetensors"
    expected = returns_of(ScoreRequest(checkpoint=path, levels=HARD))
    for number in range(3):
        played = play(number=number, checkpoint=path)
        assert played.result.normalised_return == expected[number]
        assert any(len(decision.allowed) < 5 for decision in played.decisions)
        assert all(decision.action in decision.allowed for decision in played.decisions)
    features = played.features
    assert sum(len(group.names) for group in features.groups) == features.count == len(played.decisions[0].observation)


@pytest.mark.parametrize(
    "policy", ["random", "shortest-path", "shortest-path-planned", "deadlock-avoidance", "planner-replanned", "alone"]
)
def test_a_reference_policy_comes_to_the_return_that_the_evaluator_has(policy, returns_of, play, timetabled):
    for levels in (HARD, timetabled):
        expected = returns_of(ReferenceRequest(policy=policy, orders=2, levels=levels))
        for number in (0, 2):
            played = play(levels, number, policy=policy, orders=2)
            assert played.result.normalised_return == expected[number]
            assert (played.features, played.decisions[0].scores, played.decisions[0].observation) == (None, None, None)


def test_the_moments_are_those_of_the_episode(play, timetabled):
    played = play(timetabled, 1, policy="shortest-path")
    moments = np.array(played.steps)
    assert moments.shape == (played.result.steps + 1, 7, 6)
    level = SUPPLY.evaluation("hard", 1)
    assert (moments[0, :, 0] == WAITING).all()
    assert moments[0, :, 1:4].tolist() == level.starts.tolist()
    assert played.level.grid == level.grid.tolist()
    arrived = moments[-1, :, 0] == ARRIVED
    assert int(arrived.sum()) == played.result.arrived
    assert (moments[-1, arrived, 1:3] == level.targets[arrived]).all()
    moved = np.abs(np.diff(moments[..., 1:3], axis=0)).sum(axis=2)
    assert moved.max() == 1
    broken = moments[..., 0] == BROKEN
    assert broken.any()
    assert (moved[broken[1:]] == 0).all()
    due = np.array([train.due for train in played.level.trains])
    unarrived = moments[..., 0] != ARRIVED
    after = np.arange(len(moments))[:, None] > due
    assert ((moments[..., 5] & LATE > 0)[unarrived] == after[unarrived]).all()
    assert {train.speed for train in played.level.trains} == {1, 1 / 2, 1 / 3}


def test_who_is_jammed_stays_where_it_is(play):
    """Level 3 is one where greedy trains meet head on."""
    played = play(number=3, policy="shortest-path")
    moments = np.array(played.steps)
    jammed = moments[..., 5] & JAMMED > 0
    assert played.result.arrived < 7
    assert jammed[-1].sum() >= 2
    assert (np.diff(jammed.astype(int), axis=0) >= 0).all()
    still = (moments[1:, :, 1:4] == moments[:-1, :, 1:4]).all(axis=2)
    assert still[jammed[:-1]].all()


def test_outputs_that_nobody_could_show_are_refused(tmp_path, play):
    tensors, metadata = load(PRETRAINED / "dispatch-hard.safetensors", "checkpoint")
    kept = {name: value for name, value in metadata.items() if name not in OURS}
    huge = {name: np.full_like(tensor, 3e38) for name, tensor in tensors.items()}
    save(tmp_path / "huge.safetensors", huge, kept, "checkpoint")
    with pytest.raises(UnplayableLevelError, match="hard, level 0: the network's outputs are not finite, its weights"):
        play(checkpoint=tmp_path / "huge.safetensors")


def test_observations_may_be_left_out(play):
    played = play(checkpoint=PRETRAINED / "dispatch-hard.safetensors", observations=False)
    assert {decision.observation for decision in played.decisions} == {None}


def test_without_a_name_the_largest_levels_are_played(play):
    assert play(LevelChoice(), policy="shortest-path").level.name == "hard"


def test_levels_that_are_not_there_are_refused_in_a_line(play, timetabled):
    with pytest.raises(
        ConfigError, match=r"^--number 1000: 1000 evaluation levels of hard are kept .*: use a lower one$"
    ):
        play(number=1000, policy="shortest-path")
    with pytest.raises(ConfigError, match=r"levels.npz: no level of index 3 in rush, the last is 2$"):
        play(timetabled, 3, policy="shortest-path")
    with pytest.raises(ConfigError, match=r"^unknown level 'hrad': did you mean hard\?"):
        play(LevelChoice(names=("hrad",)), policy="shortest-path")
    with pytest.raises(
        UnplayableLevelError, match=r"levels.npz: rush, level 0: the planner plans for trains of speed 1"
    ):
        play(timetabled, 0, policy="planner")
    with pytest.raises(ConfigError, match=r"^policy and checkpoint are missing"):
        play()
