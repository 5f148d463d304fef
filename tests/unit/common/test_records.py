"""Records take exactly what they declare, and an episode's figures and digest are what they claim."""

import json

import numpy as np
import pytest
from pydantic import ValidationError

from common.records import (
    CIRCUMSTANCES,
    CheckpointFile,
    CheckpointNotice,
    Episode,
    EpisodeRow,
    EvaluationRow,
    Heartbeat,
    Lease,
    ScaleRequest,
    Weights,
)

FLOATS = ("observations", "log_probabilities", "values", "rewards", "final_observations")


def episode(**changes):
    """Two trains, three steps, four decisions, two features; the second train never arrived."""
    fields = {
        "episode": 7,
        "fragment": 0,
        "first_step": 0,
        "over": True,
        "level": "easy",
        "level_seed": 99,
        "level_hash": "0" * 32,
        "weights_version": 6,
        "actor": "actor-easy-0",
        "acting_s": 0.5,
        "waited_s": 0.1,
        "max_steps": 3,
        "observations": np.arange(8, dtype=np.float32).reshape(4, 2),
        "times": np.array([0, 0, 1, 2], np.int32),
        "trains": np.array([0, 1, 1, 0], np.int32),
        "actions": np.array([2, 4, 0, 1], np.int8),
        "log_probabilities": np.zeros(4, np.float32),
        "values": np.zeros(4, np.float32),
        "rewards": np.array([[-1, -1], [-1, -1], [0, -1]], np.float32),
        "arrived_at": np.array([2, -1], np.int32),
        "final_observations": np.array([[0, 0], [1, 2]], np.float32),
        "states": np.zeros((2, 0), np.float32),
    }
    return Episode(**fields | changes)


def complaint(make):
    with pytest.raises(ValidationError) as caught:
        make()
    problem = caught.value.errors()[0]
    return ".".join(str(part) for part in problem["loc"]), problem["msg"]


def test_an_episode_without_decisions_is_an_episode():
    empty = {name: np.zeros(0, np.int32) for name in ("times", "trains")}
    empty |= {name: np.zeros(0, np.float32) for name in ("log_probabilities", "values")}
    quiet = episode(observations=np.zeros((0, 2), np.float32), actions=np.zeros(0, np.int8), **empty)
    assert len(quiet.actions) == 0


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("observations", [[1.0]], "wants an array, got list"),
        ("observations", np.zeros((4, 2)), "wants dtype float32, got float64"),
        ("observations", np.zeros(8, np.float32), "wants 2 dimensions, got shape (8,)"),
        ("observations", np.full((4, 2), np.nan, np.float32), "has non-finite numbers"),
        ("rewards", np.full((3, 2), -np.inf, np.float32), "has non-finite numbers"),
        ("times", np.zeros(4, np.int64), "wants dtype int32, got int64"),
        ("times", np.zeros(4, ">i4"), "wants dtype int32, got >i4"),
        ("times", np.zeros((4, 1), np.int32), "wants 1 dimensions, got shape (4, 1)"),
        ("times", np.zeros(3, np.int32), "times: dimension D is 3 here and 4 before"),
        ("actions", np.zeros(5, np.int8), "actions: dimension D is 5 here and 4 before"),
        ("arrived_at", np.zeros(3, np.int32), "arrived_at: dimension N is 3 here and 2 before"),
        ("final_observations", np.zeros((2, 3), np.float32), "final_observations: dimension F is 3 here and 2 before"),
        ("times", np.array([0, 0, 1, 3], np.int32), "times: wants values in 0..2"),
        ("times", np.array([-1, 0, 1, 2], np.int32), "times: wants values in 0..2"),
        ("trains", np.array([0, 1, 2, 0], np.int32), "trains: wants values in 0..1"),
        ("actions", np.array([0, 5, 0, 0], np.int8), "actions: wants values in 0..4"),
        ("actions", np.array([0, -1, 0, 0], np.int8), "actions: wants values in 0..4"),
        ("arrived_at", np.array([3, -1], np.int32), "arrived_at: wants values in -1..2"),
        ("arrived_at", np.array([0, -2], np.int32), "arrived_at: wants values in -1..2"),
        ("max_steps", 2, "rewards: wants 1..2 steps of at least one train, got 3 of 2"),
        ("first_step", 1, "times: wants values in 1..3"),
        ("fragment", 1, "first_step: 0 does not begin fragment 1"),
        ("states", np.zeros((3, 0), np.float32), "states: dimension N is 3 here and 2 before"),
    ],
)
def test_an_episode_whose_arrays_do_not_fit_is_refused(field, value, text):
    _, message = complaint(lambda: episode(**{field: value}))
    assert message == f"Value error, {text}"


def test_an_episode_needs_a_train_and_a_step():
    no_train = {
        "rewards": np.zeros((3, 0), np.float32),
        "arrived_at": np.zeros(0, np.int32),
        "final_observations": np.zeros((0, 2), np.float32),
        "observations": np.zeros((0, 2), np.float32),
        "times": np.zeros(0, np.int32),
        "trains": np.zeros(0, np.int32),
        "actions": np.zeros(0, np.int8),
        "log_probabilities": np.zeros(0, np.float32),
        "values": np.zeros(0, np.float32),
        "states": np.zeros((0, 0), np.float32),
    }
    assert "at least one train, got 3 of 0" in complaint(lambda: episode(**no_train))[1]
    no_step = no_train | {
        "rewards": np.zeros((0, 2), np.float32),
        "arrived_at": np.full(2, -1, np.int32),
        "final_observations": np.zeros((2, 2), np.float32),
        "states": np.zeros((2, 0), np.float32),
    }
    assert "at least one train, got 0 of 2" in complaint(lambda: episode(**no_step))[1]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("episode", -1),
        ("episode", 2**53),
        ("episode", 1.0),
        ("episode", "1"),
        ("episode", True),
        ("level", "impossible"),
        ("level_hash", "0" * 31),
        ("level_hash", "G" * 32),
        ("level_hash", "0" * 32 + "\n"),
        ("actor", ""),
        ("actor", "a/b"),
        ("actor", "a" * 65),
        ("actor", "a\n"),
        ("acting_s", -0.1),
        ("acting_s", float("nan")),
        ("acting_s", float("inf")),
        ("max_steps", 0),
    ],
)
def test_a_wrong_scalar_is_refused_by_its_field(field, value):
    assert complaint(lambda: episode(**{field: value}))[0] == field


def test_unknown_and_missing_fields_are_refused():
    assert complaint(lambda: episode(colour="red"))[0] == "colour"
    assert complaint(
        lambda: Lease(episode=1, level="easy", level_seed=1, weights_version=1, steps=None, progressed=None)
    ) == (
        "epsilon",
        "Field required",
    )


def test_records_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        episode().episode = 8


def test_the_digest_is_pinned():
    assert episode().digest == "5ea63f1a824ffad2c867bcbdb08b0d61"


def test_the_digest_does_not_see_who_acted_nor_how_long():
    assert episode(actor="actor-any-3", acting_s=9.0).digest == episode().digest


def test_the_digest_does_not_see_how_an_array_lies_in_memory():
    turned = np.asfortranarray(episode().observations)
    assert not turned.flags.c_contiguous
    assert episode(observations=turned).digest == episode().digest


@pytest.mark.parametrize("field", [name for name in Episode.model_fields if name not in CIRCUMSTANCES])
def test_the_digest_sees_every_other_field(field):
    before = episode(fragment=1, first_step=1, max_steps=9, times=np.array([1, 1, 2, 3], np.int32))
    changes = {"level": "hard", "level_hash": "1" * 32, "over": False, "states": np.zeros((2, 1), np.float32)}
    value = getattr(before, field)
    if field in changes:
        changed = changes[field]
    elif field == "first_step":
        changed = 0
    elif isinstance(value, np.ndarray):
        changed = value.copy()
        changed.flat[0] = 1 - changed.flat[0] if field in FLOATS else {0: 1, 1: 2, 2: 1}[int(changed.flat[0])]
    else:
        changed = value + 1
    changes = {field: changed} | ({"fragment": 0} if field == "first_step" else {})
    assert before.model_copy(update=changes).digest != before.digest


def test_rows_speak_of_return_in_files_and_of_normalised_return_in_code():
    row = EpisodeRow(
        episode=0,
        level="hard",
        seed=1,
        normalised_return=-0.25,
        arrived=1,
        trains=2,
        steps=10,
        decisions=4,
        epsilon=0.5,
        weights_version=0,
        digest="a" * 32,
        actor="actor-hard-0",
        acting_s=0.1,
        trained_unix_s=1.5,
    )
    text = row.model_dump_json(by_alias=True)
    assert json.loads(text)["return"] == -0.25
    assert "normalised_return" not in text
    assert EpisodeRow.model_validate(json.loads(text)) == row
    evaluated = {
        "episode": 1,
        "level": "easy",
        "mode": "greedy",
        "levels": 2,
        "return": -0.5,
        "arrived_share": 0.5,
        "all_arrived_share": 0.0,
        "mean_steps": 3.5,
        "weights_digest": "b" * 32,
        "evaluated_unix_s": 1.0,
        "evaluating_s": 1.0,
    }
    assert EvaluationRow.model_validate(evaluated).normalised_return == -0.5


def test_weights_take_float32_of_any_shape_and_nothing_else():
    tensors = {"bias": np.zeros(3, np.float32), "scalar": np.array(1, np.float32), "none": np.zeros((0, 2), np.float32)}
    assert Weights(version=1, tensors=tensors).tensors["scalar"].shape == ()
    where, text = complaint(lambda: Weights(version=1, tensors={"bias": np.zeros(3)}))
    assert (where, text) == ("tensors.bias", "Value error, wants dtype float32, got float64")
    assert complaint(lambda: Weights(version=1, tensors={"bias": np.array([np.nan], np.float32)}))[0] == "tensors.bias"
    assert complaint(lambda: Weights(version=1, tensors={1: np.zeros(1, np.float32)}))[0].startswith("tensors.1")


def test_counters_must_be_finite():
    beat = {"process": "learner", "role": "learner", "pid": 1, "state": "training"}
    assert Heartbeat(**beat, counters={"done": 1.0}).counters == {"done": 1.0}
    assert complaint(lambda: Heartbeat(**beat, counters={"done": float("nan")}))[0] == "counters.done"


def test_lists_and_bytes_are_bounded():
    episodes = list(range(100_000))
    assert len(CheckpointNotice(episodes=episodes, finished=False).episodes) == 100_000
    assert complaint(lambda: CheckpointNotice(episodes=[*episodes, 1], finished=False))[0] == "episodes"
    assert complaint(lambda: CheckpointFile(episode=1, content="text"))[0] == "content"
    assert complaint(lambda: ScaleRequest(actors={"easy": 257}))[0] == "actors.easy"
    assert complaint(lambda: ScaleRequest(actors={"esy": 1}))[0].startswith("actors.esy")
