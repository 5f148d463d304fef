"""Every message comes back as it was sent, and whatever is not exactly a message is refused, never run."""

import importlib
import pickle
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from fuzzing import cases, fuzz
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from made_episodes import answer_to, edited, lease_of
from msgpack import ExtType, Timestamp
from msgpack._cmsgpack import Packer

from railctl.common.records import acting, checkpoints, control, course, heartbeats, joining, rows
from railctl.common.records.base import Record
from railctl.common.wire import arrays, blocks, codec, keys
from railctl.common.wire.arrays import pack_array, unpack_array
from railctl.common.wire.blocks import take_apart
from railctl.common.wire.codec import Refused, decode, encode, encoding_of
from railctl.common.wire.keys import Service, Topic

COUNTS = st.integers(0, 2**53 - 1)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
SHARES = st.floats(0, 1)
SPANS = st.floats(0, 1e9)
NAMES = st.text("abcXYZ019_.-", min_size=1, max_size=64)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=30)
DIGESTS = st.text("0123456789abcdef", min_size=32, max_size=32)
LEVELS = st.sampled_from(["easy", "rush.40x40", "M-1_2"])
SERVES = LEVELS | st.just("any")
KEPT = st.lists(COUNTS, max_size=5)
UNITS = npst.arrays(np.int64, st.tuples(st.integers(0, 5), st.just(2)))
REALS32 = st.floats(width=32, allow_nan=False, allow_infinity=False)


def optional(strategy):
    return st.none() | strategy


@st.composite
def laid_out(draw, shape, elements=REALS32):
    """A float32 array of this shape, in any layout that numpy knows."""
    dense = draw(npst.arrays(np.float32, shape, elements=elements, fill=st.nothing()))
    how = draw(st.sampled_from(["dense", "fortran", "strided", "backwards"]))
    if how == "fortran":
        return np.asfortranarray(dense)
    if how == "strided" and dense.ndim:
        return np.repeat(dense, 2, axis=-1)[..., ::2]
    if how == "backwards" and dense.ndim:
        return np.ascontiguousarray(dense[::-1])[::-1]
    return dense


@st.composite
def leases(draw, fragment, first_step, states, steps):
    """Of a fragment that begins after `first_step` and has `steps`."""
    progressed = acting.Progressed(
        fragment=max(1, fragment),
        first_step=max(1, first_step),
        actions=draw(npst.arrays(np.int8, st.integers(0, 4), elements=st.integers(0, 4))),
        states=states,
    )
    return acting.Lease(
        episode=draw(COUNTS),
        level=draw(LEVELS),
        level_seed=draw(COUNTS),
        weights_version=draw(COUNTS),
        epsilon=draw(SHARES),
        steps=steps,
        progressed=progressed if fragment else None,
    )


@st.composite
def fragments(draw):
    steps, trains = draw(st.integers(1, 6)), draw(st.integers(1, 4))
    count, features = draw(st.integers(0, 5)), draw(st.integers(0, 40))
    first, over = draw(st.integers(0, 3)), draw(st.booleans())
    states = draw(laid_out((trains, draw(st.integers(0, 3)))))

    def whole(dtype, size, low, high):
        return draw(npst.arrays(dtype, size, elements=st.integers(low, high)))

    decisions = course.Decisions(
        observations=draw(laid_out((count, features), st.sampled_from([0.0, 0.0, 0.0, 0.0, -0.0, -1.0, 0.5]))),
        times=whole(np.int32, count, first, first + steps - 1),
        trains=whole(np.int32, count, 0, trains - 1),
        actions=whole(np.int8, count, 0, 4),
        allowed=np.full(count, 31, np.uint8),
        log_probabilities=draw(laid_out((count,))),
        values=draw(laid_out((count,))),
        labels=whole(np.int8, count, -1, 4),
        following=draw(laid_out((count, draw(st.sampled_from([0, features]))), st.sampled_from([0.0, 0.0, -1.0]))),
    )
    happened = course.Course(
        level_hash=draw(DIGESTS),
        max_steps=draw(st.integers(first + steps, 100_000)),
        first_step=first,
        over=over,
        decisions=decisions,
        rewards=draw(laid_out((steps, trains))),
        arrived_at=whole(np.int32, trains, -1, first + steps - 1),
        final_observations=draw(laid_out((trains, features), st.sampled_from([0.0, 0.0, -1.0]))),
        final_allowed=whole(np.uint8, trains, 1, 31),
        states=states,
        score=draw(optional(FLOATS)) if over else None,
    )
    lease = draw(leases(int(first > 0), first, states, steps + draw(st.integers(0, 3)) if over else steps))
    return acting.Fragment(
        lease=lease,
        course=happened,
        circumstances=acting.Circumstances(actor=draw(NAMES), acting_s=draw(SPANS), waited_s=draw(SPANS)),
    )


LEASES = st.integers(0, 3).flatmap(lambda number: leases(number, number, np.zeros((2, 3), np.float32), None))
EPISODE_ROWS = st.builds(
    rows.EpisodeRow,
    episode=COUNTS,
    level=LEVELS,
    seed=COUNTS,
    normalised_return=FLOATS,
    arrived=COUNTS,
    trains=COUNTS,
    steps=COUNTS,
    decisions=COUNTS,
    epsilon=FLOATS,
    weights_version=COUNTS,
    digest=DIGESTS,
    actor=NAMES,
    acting_s=FLOATS,
    trained_unix_s=FLOATS,
    learned_reward=optional(FLOATS),
    score=optional(FLOATS),
    staleness=optional(COUNTS),
)
EVALUATION_ROWS = st.builds(
    rows.EvaluationRow,
    episode=COUNTS,
    level=LEVELS,
    mode=st.sampled_from(["greedy", "sample"]),
    levels=COUNTS,
    normalised_return=FLOATS,
    arrived_share=FLOATS,
    all_arrived_share=FLOATS,
    mean_steps=FLOATS,
    weights_digest=DIGESTS,
    evaluated_unix_s=FLOATS,
    evaluating_s=FLOATS,
    score=optional(FLOATS),
)
ROLES = st.sampled_from(["router", "learner", "actor", "evaluator"])
PROGRESS = st.builds(
    control.Progress,
    done=COUNTS,
    leased=COUNTS,
    waiting=st.dictionaries(LEVELS, COUNTS),
    weights_version=COUNTS,
    snapshot=COUNTS,
    evaluations=COUNTS,
    evaluations_due=COUNTS,
    return_last_100=optional(FLOATS),
    staleness_last_100=optional(FLOATS),
    episodes_per_s=FLOATS,
    steps_per_s=FLOATS,
    refused=COUNTS,
    duplicates=COUNTS,
    reissued=COUNTS,
)
PROCESSES = st.builds(
    control.ProcessStatus,
    process=NAMES,
    role=ROLES,
    serves=optional(SERVES),
    pid=optional(COUNTS),
    state=TEXTS,
    restarts=COUNTS,
    last_heartbeat_unix_s=optional(FLOATS),
)
STATUSES = st.builds(
    control.Status,
    run=TEXTS,
    path=TEXTS,
    state=st.sampled_from(["starting", "running", "paused", "stopped", "failed"]),
    algorithm=TEXTS,
    episodes=COUNTS,
    supervisor_pid=optional(COUNTS),
    progress=optional(PROGRESS),
    time_left_s=optional(FLOATS),
    problems=st.lists(TEXTS, max_size=3),
    processes=st.lists(PROCESSES, max_size=3),
)
REPORTS = {
    "learner": st.builds(
        heartbeats.LearnerReport,
        done=COUNTS,
        leased=COUNTS,
        waiting=st.dictionaries(LEVELS, COUNTS),
        weights_version=COUNTS,
        snapshot=COUNTS,
        checkpoints=COUNTS,
        return_last_100=optional(FLOATS),
        staleness_last_100=optional(FLOATS),
        episodes_per_s=FLOATS,
        steps_per_s=FLOATS,
        refused=COUNTS,
        duplicates=COUNTS,
        reissued=COUNTS,
        exact_until=optional(COUNTS),
    ),
    "actor": st.builds(heartbeats.ActorReport, acted=COUNTS, kept=COUNTS),
    "evaluator": st.builds(heartbeats.EvaluatorReport, evaluations=COUNTS),
    "router": st.none(),
}


def beats(role):
    report = optional(REPORTS[role])
    return st.builds(heartbeats.Heartbeat, process=NAMES, role=st.just(role), pid=COUNTS, state=TEXTS, report=report)


SHAPES = npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
MESSAGES = {
    acting.Fragment: fragments(),
    rows.EpisodeRow: EPISODE_ROWS,
    rows.EvaluationRow: EVALUATION_ROWS,
    acting.Weights: st.builds(
        acting.Weights, version=COUNTS, tensors=st.dictionaries(TEXTS, SHAPES.flatmap(laid_out), max_size=3)
    ),
    acting.WeightsRequest: st.builds(acting.WeightsRequest, version=COUNTS),
    acting.LeaseRequest: st.builds(acting.LeaseRequest, actor=NAMES, incarnation=NAMES, serves=SERVES, kept=UNITS),
    acting.LeaseAnswer: st.builds(
        acting.LeaseAnswer, lease=optional(LEASES), safe_before=COUNTS, missing=UNITS, finished=st.booleans()
    ),
    rows.HistoryRequest: st.builds(rows.HistoryRequest, first=COUNTS),
    rows.EpisodeRows: st.builds(rows.EpisodeRows, rows=st.lists(EPISODE_ROWS, max_size=2), total=COUNTS),
    rows.EvaluationRows: st.builds(rows.EvaluationRows, rows=st.lists(EVALUATION_ROWS, max_size=2), total=COUNTS),
    checkpoints.CheckpointNotice: st.builds(checkpoints.CheckpointNotice, episodes=KEPT, finished=st.booleans()),
    checkpoints.CheckpointRequest: st.builds(checkpoints.CheckpointRequest, episode=COUNTS),
    checkpoints.CheckpointFile: st.builds(checkpoints.CheckpointFile, episode=COUNTS, content=st.binary(max_size=30)),
    control.Empty: st.builds(control.Empty),
    control.LearnerCommand: st.builds(control.LearnerCommand, verb=st.sampled_from(["pause", "resume", "checkpoint"])),
    control.ScaleRequest: st.builds(control.ScaleRequest, actors=st.dictionaries(SERVES, st.integers(0, 256))),
    control.CommandAnswer: st.builds(control.CommandAnswer, done=st.booleans(), text=TEXTS),
    heartbeats.Heartbeat: st.sampled_from(["learner", "actor", "evaluator", "router"]).flatmap(beats),
    control.Status: STATUSES,
    joining.RunIntroduction: st.builds(
        joining.RunIntroduction,
        name=TEXTS,
        namespace=st.from_regex(r"railctl/[0-9a-f]{12}", fullmatch=True),
        config=TEXTS,
    ),
    joining.LevelPartRequest: st.builds(joining.LevelPartRequest, level=SERVES, first=COUNTS),
    joining.LevelPart: st.builds(joining.LevelPart, content=st.binary(max_size=30), total=COUNTS),
}
RECORD_TYPES = pytest.mark.parametrize("record_type", MESSAGES, ids=lambda record_type: record_type.__name__)

LEASE = acting.Lease(
    episode=3, level="hard", level_seed=2**31 - 1, weights_version=2, epsilon=0.25, steps=30, progressed=None
)
LEASE_BODY = {
    "episode": 3,
    "level": "hard",
    "level_seed": 2**31 - 1,
    "weights_version": 2,
    "epsilon": 0.25,
    "steps": 30,
    "progressed": None,
}
WEIGHTS = acting.Weights(version=1, tensors={"b": np.array([[1.0], [-2.5]], np.float32)})
LEASE_HEX = (
    "9487a7657069736f646503a56c6576656ca468617264aa6c6576656c5f73656564ce7fffffff"
    "af776569676874735f76657273696f6e02a7657073696c6f6ecb3fd0000000000000"
    "a573746570731eaa70726f67726573736564c080c400c400"
)
WEIGHTS_HEX = "82a776657273696f6e01a774656e736f727381a162c7120193a33c6634920201c4080000803f000020c0"


def pack(plain):
    """Bytes that our encoder would never make."""
    return bytes(Packer().pack(plain))


def pack_lease(fields):
    """Of a lease without arrays."""
    return pack([fields, {}, b"", b""])


def array(dtype="<f4", shape=(1,), raw=b"\0\0\0\0"):
    return ExtType(arrays.ARRAY_TYPE, pack([dtype, shape, raw]))


def refusal(record_type, body, encoding=None):
    with pytest.raises(Refused) as caught:
        decode(record_type, encoding_of(record_type) if encoding is None else encoding, body)
    return str(caught.value)


def weights_refusal(tensor):
    return refusal(acting.Weights, pack({"version": 1, "tensors": {"w": tensor}}))


def same(ours, theirs):
    """Whether two values are the same in type, in value and, for arrays, in every bit."""
    if type(ours) is not type(theirs):
        return False
    if isinstance(ours, Record):
        return all(same(getattr(ours, name), getattr(theirs, name)) for name in type(ours).model_fields)
    if isinstance(ours, np.ndarray):
        layout = (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
        return layout and np.ascontiguousarray(ours).tobytes() == np.ascontiguousarray(theirs).tobytes()
    if isinstance(ours, Mapping):
        return ours.keys() == theirs.keys() and all(same(ours[key], theirs[key]) for key in ours)
    if isinstance(ours, list):
        return len(ours) == len(theirs) and all(same(a, b) for a, b in zip(ours, theirs, strict=True))
    return ours == theirs


def test_every_record_on_a_channel_is_tested_here():
    channels = vars(keys).values()
    travelling = {topic.record for topic in channels if isinstance(topic, Topic)}
    for service in channels:
        if isinstance(service, Service):
            travelling |= {service.request, service.answer}
    assert travelling == set(MESSAGES)


@fuzz
@RECORD_TYPES
@cases(40)
@given(data=st.data())
def test_a_message_comes_back_as_it_was(record_type, data):
    record = data.draw(MESSAGES[record_type])
    body = encode(record)
    back = decode(record_type, encoding_of(record_type), body)
    assert same(record, back)
    assert encode(back) == body


@fuzz
@cases(40)
@given(record=fragments())
def test_a_fragment_comes_back_as_it_was_without_its_zeros(record):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "SPARSE_FROM", 0)
        assert same(decode(acting.Fragment, encoding_of(acting.Fragment), encode(record)), record)


def test_a_fragment_of_many_zeros_is_small():
    decisions = {
        name: np.full((10_000, 50)[: len(spec.dims)], name == "allowed", spec.dtype)
        for name, spec in course.Decisions.arrays().items()
    }
    sent = edited(answer_to(lease_of(0)), **decisions, final_observations=np.zeros((1, 50), np.float32))
    body = encode(sent)
    assert len(body) < 300_000
    assert same(decode(acting.Fragment, encoding_of(acting.Fragment), body), sent)


def test_arrays_come_back_writable_and_owning_their_memory():
    tensor = decode(acting.Weights, encoding_of(acting.Weights), encode(WEIGHTS)).tensors["b"]
    assert tensor.flags.writeable
    tensor += 1
    assert tensor.tolist() == [[2.0], [-1.5]]


def test_the_bytes_of_messages_are_pinned():
    assert encode(LEASE).hex() == LEASE_HEX
    assert encode(WEIGHTS).hex() == WEIGHTS_HEX
    assert encoding_of(acting.Lease) == "application/msgpack;railctl.Lease.7"


def test_pinned_bytes_are_still_understood():
    assert decode(acting.Lease, encoding_of(acting.Lease), bytes.fromhex(LEASE_HEX)) == LEASE
    back = decode(acting.Weights, encoding_of(acting.Weights), bytes.fromhex(WEIGHTS_HEX))
    assert same(back, WEIGHTS)


def test_another_version_is_refused_by_name_before_the_body_is_looked_at():
    text = refusal(acting.Lease, b"\xc1", "application/msgpack;railctl.Lease.6")
    assert text == (
        "schema is 'application/msgpack;railctl.Lease.6', this process speaks 'application/msgpack;railctl.Lease.7'"
    )


@pytest.mark.parametrize("encoding", ["", "zenoh/bytes", "application/msgpack;railctl.Episode.1", "x" * 10_000])
def test_another_schema_is_refused_by_name(encoding):
    text = refusal(acting.Lease, encode(LEASE), encoding)
    assert encoding[:100] in text
    assert "railctl.Lease.7" in text
    assert len(text) < 300


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"colour": "red"}, "Lease: colour: Extra inputs are not permitted"),
        ({"episode": -1}, "Lease: episode: Input should be greater than or equal to 0"),
        ({"episode": "3"}, "Lease: episode: Input should be a valid integer"),
        ({"episode": 3.0}, "Lease: episode: Input should be a valid integer"),
        ({"episode": True}, "Lease: episode: Input should be a valid integer"),
        ({"episode": None}, "Lease: episode: Input should be a valid integer"),
        ({"episode": 2**64 - 1}, "Lease: episode: Input should be less than 9007199254740992"),
        ({"level": b"hard"}, "Lease: level: Input should be a valid string"),
        ({"epsilon": float("nan")}, "Lease: epsilon: Input should be a finite number"),
        ({"epsilon": float("inf")}, "Lease: epsilon: Input should be a finite number"),
        ({"epsilon": -float("inf")}, "Lease: epsilon: Input should be a finite number"),
        ({"epsilon": 1.5}, "Lease: epsilon: Input should be less than or equal to 1"),
        ({"epsilon": Timestamp(1)}, "Lease: epsilon: Input should be a valid number"),
        ({"epsilon": array()}, "Lease: epsilon: Input should be a valid number"),
    ],
)
def test_a_wrong_field_is_refused_by_name(changes, text):
    assert refusal(acting.Lease, pack_lease(LEASE_BODY | changes)) == text


@pytest.mark.parametrize("field", LEASE_BODY)
def test_a_missing_field_is_refused_by_name(field):
    body = {name: value for name, value in LEASE_BODY.items() if name != field}
    assert refusal(acting.Lease, pack_lease(body)) == f"Lease: {field}: Field required"


@pytest.mark.parametrize("plain", [None, 5, "text", b"bytes", [], [LEASE_BODY], True])
def test_what_is_no_mapping_is_refused(plain):
    assert refusal(acting.Lease, pack(plain)).startswith("Lease: ")


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (b"", "ValueError"),
        (b"\xc1", "FormatError"),
        (b"\x81", "ValueError"),
        (b"\x81\x01\x02", "ValueError"),  # a key that is no text
        (b"\xdf\xff\xff\xff\xff", "ValueError"),  # announces 2**32 - 1 pairs
        (b"\xc6\xff\xff\xff\xff", "ValueError"),  # announces 2**32 - 1 bytes
        (b"\x91" * 100_000, "StackError"),
        (b"\xa1\xff", "UnicodeDecodeError"),
        (b"\x80\x80", "ExtraData"),
    ],
)
def test_what_is_no_msgpack_is_refused(body, kind):
    assert refusal(control.Empty, body).startswith(f"Empty: not a message: {kind}: ")


@fuzz
@RECORD_TYPES
@cases(10)
@given(data=st.data())
def test_a_message_that_is_cut_off_is_refused(record_type, data):
    body = encode(data.draw(MESSAGES[record_type]))
    cut = data.draw(st.integers(0, len(body) - 1))
    refusal(record_type, body[:cut])
    refusal(record_type, body + body[:1])


@fuzz
@pytest.mark.parametrize("record_type", [acting.Fragment, acting.Weights, control.Status, control.Empty])
@cases(150)
@given(body=st.binary(max_size=200))
@example(body=b"\x80")
def test_random_bytes_are_refused_and_nothing_else_happens(record_type, body):
    try:
        taken = decode(record_type, encoding_of(record_type), body)
    except Refused:
        return
    assert record_type is control.Empty
    assert same(taken, control.Empty())


@fuzz
@pytest.mark.parametrize("record_type", [acting.Fragment, acting.LeaseAnswer, acting.Weights, control.Status])
@cases(60)
@given(data=st.data())
def test_flipped_bytes_are_refused_or_give_another_valid_message(record_type, data):
    body = bytearray(encode(data.draw(MESSAGES[record_type])))
    for _ in range(data.draw(st.integers(1, 3))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    try:
        taken = decode(record_type, encoding_of(record_type), bytes(body))
    except Refused:
        return
    again = decode(record_type, encoding_of(record_type), encode(taken))
    assert same(taken, again)


PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=8),
    lambda children: st.lists(children, max_size=4) | st.dictionaries(st.text(max_size=3), children, max_size=3),
    max_leaves=8,
)
ARRAY_DTYPE_LIKE = st.sampled_from([*sorted(arrays.ARRAY_DTYPES), ">f4", "<f2", "|O", "<U4", "|V4", "f4", ""]) | PLAIN
SHAPE_LIKE = st.lists(st.integers(-1, 2**33), max_size=10) | st.lists(st.integers(0, 3), max_size=3) | PLAIN
EXTENSIONS = (
    st.builds(ExtType, st.integers(0, 127), st.binary(max_size=12))
    | st.builds(
        lambda parts: ExtType(arrays.SPARSE_TYPE, pack(parts)),
        st.tuples(SHAPE_LIKE, st.binary(max_size=3) | PLAIN, st.binary(max_size=16)) | PLAIN,
    )
    | st.builds(
        lambda parts: ExtType(arrays.ARRAY_TYPE, pack(parts)),
        st.tuples(ARRAY_DTYPE_LIKE, SHAPE_LIKE, st.binary(max_size=16)) | PLAIN,
    )
)


@fuzz
@cases(300)
@given(tensor=EXTENSIONS)
@example(tensor=array("<f4", [0, 2**31 - 1, 2**31 - 1, 2**31 - 1], b""))
@example(tensor=array("<f4", {}, b"\0\0\0\0"))
@example(tensor=array("<f4", [1], "abcd"))
def test_what_pretends_to_be_an_array_is_refused_or_one(tensor):
    try:
        taken = decode(acting.Weights, encoding_of(acting.Weights), pack({"version": 1, "tensors": {"w": tensor}}))
    except Refused:
        return
    assert taken.tensors["w"].dtype == np.float32
    assert np.isfinite(taken.tensors["w"]).all()


@pytest.mark.parametrize(
    ("tensor", "reason"),
    [
        (ExtType(3, b""), "unknown extension type 3"),
        (array("|O", [1], b"\0" * 8), "array dtype '|O' is not taken"),
        (array(">f4"), "array dtype '>f4' is not taken"),
        (array("<U1"), "array dtype '<U1' is not taken"),
        (array(None), "array dtype None is not taken"),
        (array(shape=[2]), "array of shape (2,) and dtype <f4 has 4 bytes"),
        (array(shape=[]), None),  # a scalar
        (array(shape=[], raw=b""), "array of shape () and dtype <f4 has 0 bytes"),
        (array(shape=[1], raw=b"\0" * 5), "array of shape (1,) and dtype <f4 has 5 bytes"),
        (array(shape=[-1]), "array shape [-1] is not taken"),
        (array(shape=[1.0]), "array shape [1.0] is not taken"),
        (array(shape=[True]), "array shape [True] is not taken"),
        (array(shape=[2**31]), "array shape [2147483648] is not taken"),
        (array(shape=[1] * 9), "array shape [1, 1, 1, 1, 1, 1, 1, 1, 1] is not taken"),
        (array("<f8", [1], b"\0" * 8), "Weights: tensors.w: Value error, wants dtype float32, got float64"),
        (array(raw=np.float32("nan").tobytes()), "Weights: tensors.w: Value error, has non-finite numbers"),
        (array(raw=np.float32("-inf").tobytes()), "Weights: tensors.w: Value error, has non-finite numbers"),
        ([1.0], "Weights: tensors.w: Value error, wants an array, got list"),
    ],
)
def test_an_array_is_taken_or_refused_by_what_is_wrong_with_it(tensor, reason):
    if reason is None:
        body = pack({"version": 1, "tensors": {"w": tensor}})
        assert decode(acting.Weights, encoding_of(acting.Weights), body).tensors["w"].shape == ()
    else:
        assert weights_refusal(tensor) == reason


def with_lengths(**changes):
    return lambda fields, lengths, *blocks: [fields, lengths | changes, *blocks]


def with_blocks(change):
    return lambda fields, lengths, *blocks: [fields, lengths, *change(*blocks)]


def without_length(fields, lengths, *blocks):
    del lengths["T"]
    return [fields, lengths, *blocks]


def with_an_array_among_its_fields(fields, *others):
    fields["course"]["rewards"] = array()
    return [fields, *others]


def without_a_course(fields, *others):
    del fields["course"]
    return [fields, *others]


def without_decisions(fields, *others):
    fields["course"]["decisions"] = []
    return [fields, *others]


def not_a_number(floats, *others):
    return [np.float32("nan").tobytes() + floats[4:], *others]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda *parts: list(parts), None),
        (lambda *parts: list(parts[:5]), "Fragment: wants fields, lengths and 4 blocks"),
        (lambda *parts: [*parts, b""], "Fragment: wants fields, lengths and 4 blocks"),
        (lambda *parts: dict(enumerate(parts)), "Fragment: not a message: ValueError: int is not allowed for map key"),
        (
            lambda fields, lengths, *blocks: [fields, list(lengths), *blocks],
            "Fragment: wants fields, lengths and 4 blocks",
        ),
        (without_length, "Fragment: rewards of ('T', 'N') in {"),
        (with_lengths(T=99), "Fragment: rewards of ('T', 'N') in {'D': 2, 'F': 1, 'G': 0, 'N': 1, 'S': 0, 'T': 99}"),
        (with_lengths(T=1), "Fragment: course: Value error, decisions.times: wants values in 0..0"),
        (with_lengths(D=1), "Fragment: course: Value error, decisions.trains: wants values in 0..0"),
        (with_lengths(D=3), "Fragment: trains of ('D',) in {"),
        (with_lengths(F=-1), "Fragment: length F is -1"),
        (with_lengths(F=True), "Fragment: length F is True"),
        (with_lengths(F=1.0), "Fragment: length F is 1.0"),
        (with_lengths(F="1"), "Fragment: length F is '1'"),
        (with_lengths(F=2**31), "Fragment: length F is 2147483648"),
        (with_lengths(F=2**31 - 1), "Fragment: final_observations of ('N', 'F') in {"),
        (
            with_lengths(E=0),
            "lengths of ['D', 'E', 'F', 'G', 'N', 'S', 'T'] for shapes of ['D', 'F', 'G', 'N', 'S', 'T']",
        ),
        (
            with_lengths(Z=1),
            "lengths of ['D', 'F', 'G', 'N', 'S', 'T', 'Z'] for shapes of ['D', 'F', 'G', 'N', 'S', 'T']",
        ),
        (
            with_blocks(lambda *blocks: [*blocks[:2], blocks[2] + b"\0", blocks[3]]),
            "Fragment: more numbers of int8 than in arrays",
        ),
        (with_blocks(lambda *blocks: [*blocks[:2], b"", blocks[3]]), "Fragment: actions of ('D',) in {"),
        (with_blocks(lambda *blocks: [blocks[0] + b"\0", *blocks[1:]]), "Fragment: not a message: ValueError: buffer"),
        (with_blocks(lambda *blocks: [[1.0], *blocks[1:]]), "[1.0] is no block of float32"),
        (with_blocks(lambda *blocks: [array("<f8", [1], b"\0" * 8), *blocks[1:]]), "is no block of float32"),
        (with_blocks(lambda *blocks: [array("<f4", [1, 1]), *blocks[1:]]), "is no block of float32"),
        (with_blocks(not_a_number), "Fragment: course: Value error, rewards: has non-finite numbers"),
        (with_an_array_among_its_fields, "Fragment: rewards is not in a block"),
        (without_a_course, "Fragment: course: Field required"),
        (without_decisions, "Fragment: course.decisions: Input should be a valid dictionary"),
    ],
)
def test_blocks_are_taken_or_refused_by_what_is_wrong_with_them(change, text):
    body = pack(change(*take_apart(answer_to(lease_of(0)))))
    if text is None:
        assert decode(acting.Fragment, encoding_of(acting.Fragment), body).circumstances.actor == "a"
    else:
        assert text in refusal(acting.Fragment, body)


def test_a_report_of_another_role_is_refused():
    body = {"process": "learner", "role": "learner", "pid": 1, "state": "training", "report": {"acted": 1, "kept": 2}}
    assert refusal(heartbeats.Heartbeat, pack(body)) == (
        "Heartbeat: message: Value error, report: role learner sends no ActorReport"
    )
    body["report"] = {"done": 1}
    assert refusal(heartbeats.Heartbeat, pack(body)).endswith("leased: Field required")


def sparse(shape=(16,), bits=b"\x80\x00", raw=b"\0\0\x80\x3f"):
    return ExtType(arrays.SPARSE_TYPE, pack([shape, bits, raw]))


def mostly_zeros():
    numbers = np.zeros((80, 150), np.float32)
    numbers[3, 7], numbers[79, 149], numbers[0, 0] = -1.5, -0.0, np.float32(1e-45)
    return numbers


def test_what_is_mostly_zeros_travels_as_what_is_not_and_comes_back_to_the_bit():
    sent = acting.Weights(version=1, tensors={"x": mostly_zeros()})
    body = encode(sent)
    assert len(body) < 12_000 // 8 + 3 * 4 + 50
    assert same(decode(acting.Weights, encoding_of(acting.Weights), body), sent)
    dense = acting.Weights(version=1, tensors={"x": np.ones((80, 150), np.float32)})
    assert len(encode(dense)) > 48_000


@pytest.mark.parametrize(
    ("tensor", "reason"),
    [
        (sparse(), None),
        (sparse(shape=[1, 9, 1]), None),
        (sparse(shape=[17]), "sparse array of shape (17,) has a map of 2 bytes"),
        (sparse(shape=[8]), "sparse array of shape (8,) has a map of 2 bytes"),
        (sparse(shape=[-1]), "array shape [-1] is not taken"),
        (sparse(bits=b"\x80\x01"), "sparse array of shape (16,) has 1 numbers that do not fit its map"),
        (sparse(shape=[9], bits=b"\x00\x40"), "sparse array of shape (9,) has 1 numbers that do not fit its map"),
        (sparse(raw=b"\0\0\0\0"), "sparse array of shape (16,) has 1 numbers that do not fit its map"),
        (sparse(raw=b"\0\0\0"), "Weights: not a message: ValueError: buffer size must be a multiple of element size"),
        (sparse(raw=np.float32("nan").tobytes()), "Weights: tensors.w: Value error, has non-finite numbers"),
    ],
)
def test_a_sparse_array_is_taken_or_refused_by_what_is_wrong_with_it(tensor, reason):
    if reason is not None:
        assert weights_refusal(tensor) == reason
        return
    body = pack({"version": 1, "tensors": {"w": tensor}})
    taken = decode(acting.Weights, encoding_of(acting.Weights), body).tensors["w"]
    assert taken.reshape(-1)[0] == 1
    assert np.count_nonzero(taken) == 1
    assert taken.flags.writeable


def test_a_small_message_cannot_fill_the_memory(monkeypatch):
    monkeypatch.setattr(arrays, "MAX_ARRAY_BYTES", 63)
    assert weights_refusal(sparse()) == "sparse array of shape (16,) exceeds the limit of 63 bytes"


def test_more_than_the_limit_is_neither_sent_nor_taken(monkeypatch):
    body = encode(LEASE)
    monkeypatch.setattr(codec, "MAX_MESSAGE_BYTES", len(body))
    assert decode(acting.Lease, encoding_of(acting.Lease), encode(LEASE)) == LEASE
    monkeypatch.setattr(codec, "MAX_MESSAGE_BYTES", len(body) - 1)
    assert refusal(acting.Lease, body) == f"{len(body)} bytes exceed the limit of {len(body) - 1}"
    with pytest.raises(ValueError, match=f"a Lease of {len(body)} bytes exceeds the limit of {len(body) - 1}"):
        encode(LEASE)


def test_only_plain_numbers_are_sent_as_arrays():
    for wrong in (np.array(["a"]), np.array([None]), np.array([1], np.uint16), np.array([1], np.float16), {1}):
        with pytest.raises(TypeError, match="cannot send"):
            pack_array(wrong)
    swapped = pack_array(np.array([1.5, -2], ">f8"))
    assert unpack_array(swapped.code, swapped.data).tolist() == [1.5, -2]


class Touch:
    """Unpickling it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def hostile(path):
    """What msgpack_numpy takes for an array of objects, and unpickles."""
    return {b"nd": True, b"kind": b"O", b"type": "|O", b"shape": [1], b"data": pickle.dumps(Touch(path))}


@pytest.fixture
def patched():
    """The msgpack of a process that has imported flatland-rl."""
    importlib.import_module("flatland.envs.persistence")
    msgpack = importlib.import_module("msgpack")
    assert msgpack.unpackb.__module__ == "msgpack_numpy", "flatland-rl patches msgpack no more: drop these tests"
    return msgpack


def test_the_patched_unpackb_runs_what_a_message_asks_it_to(patched, tmp_path):
    patched.unpackb(pack(hostile(tmp_path / "ran")))
    assert (tmp_path / "ran").exists()  # so the tests below mean something


@pytest.mark.parametrize(
    "wrap",
    [
        lambda bad: bad,
        lambda bad: {"version": 1, "tensors": bad},
        lambda bad: {"version": 1, "tensors": {"w": bad}},
        lambda bad: {"version": 1, "tensors": {"w": ExtType(arrays.ARRAY_TYPE, pack(bad))}},
        lambda bad: {"version": 1, "tensors": {"w": ExtType(arrays.ARRAY_TYPE, pack([bad, [1], b""]))}},
        lambda bad: {"version": 1, "tensors": {"w": ExtType(arrays.ARRAY_TYPE, pack(["<f4", bad, b""]))}},
        lambda bad: {"version": 1, "tensors": {"w": ExtType(arrays.ARRAY_TYPE, pack(["<f4", [1], bad]))}},
    ],
)
def test_a_message_that_wants_to_be_unpickled_is_refused_and_not_run(patched, tmp_path, wrap):
    refusal(acting.Weights, pack(wrap(hostile(tmp_path / "ran"))))
    assert not (tmp_path / "ran").exists()


def test_flatland_changes_no_byte(patched):
    assert encode(LEASE).hex() == LEASE_HEX
    assert encode(WEIGHTS).hex() == WEIGHTS_HEX
    back = decode(acting.Weights, encoding_of(acting.Weights), bytes.fromhex(WEIGHTS_HEX))
    assert same(back, WEIGHTS)


def test_a_refusal_is_short_whatever_the_message_names():
    body = pack_lease(LEASE_BODY | {"x" * 1_000_000: 1})
    assert len(refusal(acting.Lease, body)) < 10_000


def test_what_is_large_and_wrong_is_refused_without_being_written_out():
    body = Packer().pack([{f"x{number}": 0 for number in range(1000)}, {"K": 0}, b""])
    with pytest.raises(Refused, match=r"^LeaseRequest: \d+ fields are not as declared$"):
        decode(acting.LeaseRequest, encoding_of(acting.LeaseRequest), body)
    with pytest.raises(Refused, match=r"^\[1, 1, .{0,60} is no block of int64$"):
        decode(acting.LeaseRequest, encoding_of(acting.LeaseRequest), Packer().pack([{}, {"K": 0}, [1] * 100_000]))


def test_actions_so_far_are_those_that_there_are():
    states = np.zeros((1, 0), np.float32)
    with pytest.raises(ValueError, match=r"actions: wants values in 0\.\.4"):
        acting.Progressed(fragment=1, first_step=1, actions=np.array([5], np.int8), states=states)
