"""Records take exactly what they declare, and an episode's figures and digest are what they claim."""

import json

import numpy as np
import pytest
from made_episodes import course_of, decisions_of, edited, fragment_of, lease_of
from pydantic import ValidationError

from railctl.common.records.acting import (
    MOST_KEPT,
    Fragment,
    Lease,
    LeaseRequest,
    Progressed,
    Weights,
    digest_of,
)
from railctl.common.records.base import Record
from railctl.common.records.checkpoints import CheckpointFile, CheckpointNotice
from railctl.common.records.control import ScaleRequest
from railctl.common.records.course import Course, Decisions, normalised_return
from railctl.common.records.heartbeats import ActorReport, EvaluatorReport, Heartbeat
from railctl.common.records.rows import EpisodeRow, EvaluationRow

FLOATS = ("observations", "following", "log_probabilities", "values", "rewards", "final_observations")


def episode(**changes):
    """Two trains, three steps, four decisions, two features; the second train never arrived."""
    decided = [(0, 0, 2, [0, 1]), (0, 1, 4, [2, 3]), (1, 1, 0, [4, 5]), (2, 0, 1, [6, 7])]
    course = course_of([[-1, -1], [-1, -1], [0, -1]], [2, -1], decisions_of(decided, 2), [[0, 0], [1, 2]], max_steps=3)
    made = fragment_of(lease_of(7, level_seed=99, weights_version=6), course, "actor-easy-0")
    return checked(edited(made, **changes))


def checked(record):
    """The record, made again from its fields with all their checks."""
    fields = {name: getattr(record, name) for name in type(record).model_fields}
    return type(record)(
        **{name: checked(value) if isinstance(value, Record) else value for name, value in fields.items()}
    )


def complaint(make):
    with pytest.raises(ValidationError) as caught:
        make()
    problem = caught.value.errors()[0]
    return ".".join(str(part) for part in problem["loc"]), problem["msg"]


def test_an_episode_without_decisions_is_an_episode():
    assert len(episode(decisions=decisions_of([], 2)).course.decisions) == 0


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("observations", [[1.0]], "observations: wants an array, got list"),
        ("observations", np.zeros((4, 2)), "observations: wants dtype float32, got float64"),
        ("observations", np.zeros(8, np.float32), "observations: wants 2 dimensions, got shape (8,)"),
        ("observations", np.full((4, 2), np.nan, np.float32), "observations: has non-finite numbers"),
        ("rewards", np.full((3, 2), -np.inf, np.float32), "rewards: has non-finite numbers"),
        ("times", np.zeros(4, np.int64), "times: wants dtype int32, got int64"),
        ("times", np.zeros(4, ">i4"), "times: wants dtype int32, got >i4"),
        ("times", np.zeros((4, 1), np.int32), "times: wants 1 dimensions, got shape (4, 1)"),
        ("times", np.zeros(3, np.int32), "times: dimension D is 3 here and 4 before"),
        ("actions", np.zeros(5, np.int8), "actions: dimension D is 5 here and 4 before"),
        ("arrived_at", np.zeros(3, np.int32), "arrived_at: dimension N is 3 here and 2 before"),
        ("final_observations", np.zeros((2, 3), np.float32), "final_observations: dimension F is 3 here and 2 before"),
        ("times", np.array([0, 0, 1, 3], np.int32), "decisions.times: wants values in 0..2"),
        ("times", np.array([-1, 0, 1, 2], np.int32), "decisions.times: wants values in 0..2"),
        ("trains", np.array([0, 1, 2, 0], np.int32), "decisions.trains: wants values in 0..1"),
        ("actions", np.array([0, 5, 0, 0], np.int8), "decisions.actions: wants values in 0..4"),
        ("actions", np.array([0, -1, 0, 0], np.int8), "decisions.actions: wants values in 0..4"),
        ("allowed", np.array([31, 0, 31, 31], np.uint8), "decisions.allowed: wants values in 1..31"),
        ("allowed", np.array([31, 32, 31, 31], np.uint8), "decisions.allowed: wants values in 1..31"),
        ("final_allowed", np.array([31, 0], np.uint8), "final_allowed: wants values in 1..31"),
        ("arrived_at", np.array([3, -1], np.int32), "arrived_at: wants values in -1..2"),
        ("arrived_at", np.array([0, -2], np.int32), "arrived_at: wants values in -1..2"),
        ("max_steps", 2, "rewards: wants 1..2 steps of at least one train, got 3 of 2"),
        ("first_step", 1, "decisions.times: wants values in 1..3"),
        ("over", False, "course: is not over, its lease covers all of it"),
        ("score", 0.5, None),
        ("states", np.zeros((3, 0), np.float32), "states: dimension N is 3 here and 2 before"),
        ("following", np.zeros((3, 2), np.float32), "following: dimension D is 3 here and 4 before"),
        ("following", np.zeros((4, 1), np.float32), "decisions.following: wants no features or 2, got 1"),
    ],
)
def test_an_episode_whose_arrays_do_not_fit_is_refused(field, value, text):
    if text is None:
        assert getattr(episode(**{field: value}).course, field) == value
        return
    _, message = complaint(lambda: episode(**{field: value}))
    assert message == f"Value error, {text}"


def leased(steps, first_step=0):
    before = {"actions": np.zeros(0, np.int8), "states": np.zeros((1, 0), np.float32)}
    progressed = Progressed(fragment=1, first_step=first_step, **before) if first_step else None
    return lease_of(0, steps=steps, progressed=progressed)


def a_course(steps, over, **changes):
    return course_of(np.zeros((steps, 1)), [-1], decisions_of([], 1), over=over, max_steps=9, **changes)


@pytest.mark.parametrize(
    ("lease", "course", "text"),
    [
        (leased(3), a_course(3, over=False), None),
        (leased(3), a_course(2, over=True), None),
        (leased(3, first_step=2), a_course(3, over=False, first_step=2), None),
        (leased(3), a_course(2, over=False), "course: has 2 steps, its lease 3"),
        (leased(3), a_course(4, over=False), "course: has 4 steps, its lease 3"),
        (leased(3), a_course(4, over=True), "course: has 4 steps, its lease 3"),
        (leased(None), a_course(4, over=False), "course: is not over, its lease covers all of it"),
        (
            leased(3, first_step=1),
            a_course(3, over=False, first_step=2),
            "course: begins after step 2, its lease after 1",
        ),
    ],
)
def test_a_course_answers_its_lease(lease, course, text):
    if text is None:
        assert fragment_of(lease, course).course is course
    else:
        assert complaint(lambda: fragment_of(lease, course))[1] == f"Value error, {text}"


def fields_of(record):
    return {name: getattr(record, name) for name in type(record).model_fields}


def test_what_a_process_made_itself_is_as_if_checked():
    course = episode().course
    made = Course.made(**fields_of(course) | {"decisions": Decisions.made(**fields_of(course.decisions))})
    assert digest_of(made) == digest_of(course)
    assert made.measured() == course.measured() == {"D": 4, "F": 2, "G": 0, "T": 3, "N": 2, "S": 0}


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("rewards", np.full((3, 2), np.nan, np.float32), "rewards: has non-finite numbers"),
        ("rewards", np.zeros((3, 2)), "rewards: wants dtype float32, got float64"),
        ("arrived_at", np.zeros(3, np.int32), "arrived_at: dimension N is 3 here and 2 before"),
        ("final_observations", np.zeros((2, 3), np.float32), "final_observations: dimension F is 3 here and 2 before"),
    ],
)
def test_arrays_are_looked_at_whoever_made_them(field, value, text):
    with pytest.raises(ValueError, match=text):
        Course.made(**fields_of(episode().course) | {field: value})


def test_a_record_is_not_checked_anew_within_another(monkeypatch):
    parts, calls = fields_of(episode()), []
    monkeypatch.setattr(Course, "check", lambda course: calls.append(course.first_step))
    Fragment(**parts)
    assert calls == []
    Course(**fields_of(parts["course"]))
    assert len(calls) == 1


def test_lengths_agree_across_nested_records():
    states = np.zeros((1, 4), np.float32)
    progressed = Progressed(fragment=1, first_step=1, actions=np.zeros(9, np.int8), states=states)
    lease = lease_of(0, steps=3, progressed=progressed)
    assert fragment_of(lease, a_course(3, over=False, first_step=1, states=states)).lease.fragment == 1
    for wrong, letter, sizes in ((np.zeros((1, 2), np.float32), "S", "2 here and 4"),):
        course = a_course(3, over=False, first_step=1, states=wrong)
        text = complaint(lambda course=course: fragment_of(lease, course))[1]
        assert text == f"Value error, course.states: dimension {letter} is {sizes} before"


def test_a_score_belongs_to_the_end():
    text = complaint(lambda: a_course(3, over=False, score=0.5))[1]
    assert text == "Value error, score: 0.5 of an episode that is not over"


@pytest.mark.parametrize(
    ("arrived_at", "steps", "expected"),
    [
        ([-1, -1], 10, -20 / 20),  # nobody arrives
        ([2, -1], 10, -12 / 20),
        ([2, 3], 4, (-5 + 2) / 20),  # everyone gets 1 on step 3
        ([0, 0], 1, 2 / 20),
    ],
)
def test_returns_worked_by_hand(arrived_at, steps, expected):
    assert normalised_return(np.array(arrived_at, np.int32), steps, max_steps=10) == expected


def test_the_return_is_the_studys_whatever_is_learned_from():
    assert episode().course.normalised_return == -(2 + 3) / (2 * 3)
    assert episode(rewards=np.full((3, 2), 7.5, np.float32)).course.normalised_return == -(2 + 3) / (2 * 3)


def test_an_episode_needs_a_train_and_a_step():
    assert (
        "at least one train, got 3 of 0" in complaint(lambda: course_of(np.zeros((3, 0)), [], decisions_of([], 2)))[1]
    )
    assert (
        "at least one train, got 0 of 2"
        in complaint(lambda: course_of(np.zeros((0, 2)), [-1, -1], decisions_of([], 2)))[1]
    )


def test_decisions_are_picked_and_joined_in_all_their_columns():
    decisions = episode().course.decisions
    parts = [decisions.chosen(slice(0, 1)), decisions.chosen(decisions.times > 0), decisions.chosen(slice(0, 0))]
    assert [len(part) for part in parts] == [1, 2, 0]
    joined = Decisions.joined(parts)
    assert joined.actions.tolist() == [2, 0, 1]
    assert digest_of(Decisions.joined([decisions])) == digest_of(decisions)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("episode", -1),
        ("episode", 2**53),
        ("episode", 1.0),
        ("episode", "1"),
        ("episode", True),
        ("level", "no name"),
        ("level", ""),
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
        ("acting_s", 1.7e308),  # two of these are no number
        ("waited_s", 1.7e308),
        ("max_steps", 0),
    ],
)
def test_a_wrong_scalar_is_refused_by_its_field(field, value):
    assert complaint(lambda: episode(**{field: value}))[0] == field


def test_levels_have_any_name():
    assert episode(level="rush.40x40").lease.level == "rush.40x40"


def test_unknown_and_missing_fields_are_refused():
    whole = episode()
    for part in (whole, whole.lease, whole.course, whole.course.decisions):
        fields = {name: getattr(part, name) for name in type(part).model_fields}
        assert complaint(lambda part=part, fields=fields: type(part)(colour="red", **fields))[0] == "colour"
    assert complaint(
        lambda: Lease(episode=1, level="easy", level_seed=1, weights_version=1, steps=None, progressed=None)
    ) == (
        "epsilon",
        "Field required",
    )


def test_records_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        episode().lease.episode = 8


def test_the_digest_is_pinned():
    assert episode().digest == "17d9c94d78252efafc2abc75643bc101"
    assert episode(following=np.ones((4, 2), np.float32)).digest == "923310c3aa8407ee2561ad285029b478"


def test_the_digest_does_not_see_who_acted_nor_how_long():
    assert episode(actor="actor-any-3", acting_s=9.0).digest == episode().digest


def test_the_digest_does_not_see_how_an_array_lies_in_memory():
    turned = np.asfortranarray(episode().course.decisions.observations)
    assert not turned.flags.c_contiguous
    assert episode(observations=turned).digest == episode().digest


FIELDS = [name for record in (Lease, Course, Decisions) for name in record.model_fields if name != "decisions"]


@pytest.mark.parametrize("field", FIELDS)
def test_the_digest_sees_every_other_field(field):
    before = episode(following=np.zeros((4, 2), np.float32))
    states = np.zeros((2, 1), np.float32)
    changes = {
        "level": "hard",
        "level_hash": "1" * 32,
        "over": False,
        "states": states,
        "epsilon": 0.25,
        "steps": 3,
        "score": 0.5,
        "progressed": Progressed(fragment=1, first_step=1, actions=np.zeros(0, np.int8), states=states),
    }
    parts = {**dict(before.lease), **dict(before.course), **dict(before.course.decisions)}
    value = parts[field]
    if field in changes:
        changed = changes[field]
    elif isinstance(value, np.ndarray):
        changed = value.copy()
        changed.flat[0] = (
            1 - changed.flat[0] if field in FLOATS else {-1: 0, 0: 1, 1: 2, 2: 1, 31: 30}[int(changed.flat[0])]
        )
    else:
        changed = value + 1
    assert edited(before, **{field: changed}).digest != before.digest


def test_the_digest_sees_which_record_a_field_is_in():
    assert set(Fragment.model_fields) == {"lease", "course", "circumstances"}
    before = episode()
    assert digest_of(before.lease) != digest_of(before.course)


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
    assert (row.learned_reward, row.score) == (None, None)  # as rows were before these were kept
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


def test_a_heartbeat_carries_the_report_of_its_role():
    beat = {"process": "actor-easy-0", "role": "actor", "pid": 1, "state": "acting"}
    assert Heartbeat(**beat, report=None).report is None
    assert Heartbeat(**beat, report=ActorReport(acted=3, kept=1)).report.acted == 3
    text = complaint(lambda: Heartbeat(**beat, report=EvaluatorReport(evaluations=1)))[1]
    assert text == "Value error, report: role actor sends no EvaluatorReport"
    assert complaint(lambda: ActorReport(acted=3, kept=-1))[0] == "kept"


def test_lists_and_bytes_are_bounded():
    episodes = list(range(100_000))
    assert len(CheckpointNotice(episodes=episodes, finished=False).episodes) == 100_000
    assert complaint(lambda: CheckpointNotice(episodes=[*episodes, 1], finished=False))[0] == "episodes"
    assert complaint(lambda: CheckpointFile(episode=1, content="text"))[0] == "content"
    assert complaint(lambda: ScaleRequest(actors={"easy": 257}))[0] == "actors.easy"
    assert complaint(lambda: ScaleRequest(actors={"e y": 1}))[0].startswith("actors.e y")


def test_a_question_for_work_names_so_many_fragments_and_the_first_ones():
    kept = {(episode, 0) for episode in range(MOST_KEPT + 1)}
    named = LeaseRequest.naming("a", "a-1", "any", kept).kept
    assert (named.shape, named[0].tolist(), named[-1].tolist()) == ((MOST_KEPT, 2), [0, 0], [MOST_KEPT - 1, 0])
    assert LeaseRequest.naming("a", "a-1", "any", ()).kept.shape == (0, 2)
    more = np.array(sorted(kept))
    _, message = complaint(lambda: LeaseRequest(actor="a", incarnation="a-1", serves="any", kept=more))
    assert message == "Value error, kept: names 10001 fragments, 10000 are the most"


def test_an_action_that_was_not_allowed_is_refused():
    taken = {"actions": np.array([0, 1, 2, 4], np.int8)}
    assert episode(**taken, allowed=1 << taken["actions"].astype(np.uint8)).course.decisions.allowed.max() == 16
    _, message = complaint(lambda: episode(**taken, allowed=np.array([31, 2, 3, 31], np.uint8)))
    assert message == "Value error, decisions.actions: one is not among those allowed"
