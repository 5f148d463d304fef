"""What the learner must not forget comes back from a snapshot, also from one that an earlier version wrote."""

import numpy as np
import pytest
from made_episodes import cut, edited, make_episode
from msgpack._cmsgpack import Packer, unpackb

from railctl.common.wire.arrays import pack_array, unpack_array
from railctl.common.wire.codec import encode
from railctl.services.learner.compile import learning
from railctl.services.learner.learning import build_trainer
from railctl.services.learner.memory import Memory, take_memory
from railctl.services.learner.opened import OpenEpisode
from railctl.services.learner.selfcheck import made_up_episode

NOTED = {"loss": [0.1, 0.25], "updates": [1.0]}


def weights(number):
    return {"q.bias": np.full(3, number, np.float32)}


def test_a_memory_comes_back_and_leaves_what_is_not_its_own():
    fragments = cut(make_episode(3), [7, 20])[:2]
    snapshot = Memory({4: weights(4), 11: weights(11)}, weights(5), fragments, NOTED).tensors() | {
        "replay/x": np.zeros(1)
    }
    memory = take_memory(snapshot)
    assert list(snapshot) == ["replay/x"]
    assert {version: tensors["q.bias"][0] for version, tensors in memory.older.items()} == {4: 4.0, 11: 11.0}
    assert memory.settled["q.bias"].tolist() == [5.0] * 3
    assert memory.noted == NOTED
    assert OpenEpisode(memory.opened).digest == OpenEpisode(fragments).digest


def packed(plain):
    return np.frombuffer(bytes(Packer(default=pack_array).pack(plain)), np.uint8)


def all_allowed(fragment):
    """What an earlier version knew of: nothing was forbidden."""
    count = len(fragment.course.decisions)
    final = np.full(len(fragment.course.arrived_at), 31, np.uint8)
    return edited(fragment, allowed=np.full(count, 31, np.uint8), final_allowed=final)


def in_all_blocks(fragment):
    """As schema 5 had it: nothing is said of what followed."""
    whole, lengths, *blocks = unpackb(encode(fragment), ext_hook=unpack_array)
    assert lengths.pop("G") == 0
    return packed([whole, lengths, *blocks])


def in_blocks(fragment):
    """As schema 4 had it: nothing is said of what was allowed either."""
    whole, lengths, floats, long, short, allowed = unpackb(in_all_blocks(fragment).tobytes(), ext_hook=unpack_array)
    assert set(allowed) == {31}
    return packed([whole, lengths, floats, long, short[: -len(fragment.course.decisions)]])


def mapped(fragment):
    """As schema 3 had it."""
    plain = fragment.model_dump()
    del plain["course"]["final_allowed"], plain["course"]["decisions"]["allowed"]
    del plain["course"]["decisions"]["labels"], plain["course"]["decisions"]["following"]
    return packed(plain)


def flat(fragment):
    """As schema 2 had it."""
    lease, course = fragment.lease, dict(fragment.course)
    del course["score"], course["final_allowed"]
    decisions = dict(course.pop("decisions"))
    del decisions["allowed"], decisions["labels"], decisions["following"]
    numbers = {"fragment": lease.fragment}
    numbers |= {name: getattr(lease, name) for name in ("episode", "level", "level_seed", "weights_version")}
    plain = numbers | course | decisions | dict(fragment.circumstances)
    return packed(plain)


@pytest.mark.parametrize("features", [6, 1000])  # few enough to be packed as they are, or without their zeros
@pytest.mark.parametrize("earlier", [flat, mapped, in_blocks, in_all_blocks])
def test_an_open_episode_of_an_earlier_version_comes_back(earlier, features):
    fragments = [all_allowed(fragment) for fragment in cut(make_episode(3, features, density=0.1), [7, 20])[:2]]
    memory = take_memory({f"open/{number:06d}": earlier(fragment) for number, fragment in enumerate(fragments)})
    assert [fragment.lease.unit for fragment in memory.opened] == [(3, 0), (3, 1)]
    ours, theirs = OpenEpisode(memory.opened), OpenEpisode(fragments)
    assert (ours.steps, ours.decisions, ours.reward) == (theirs.steps, theirs.decisions, theirs.reward)
    assert ours.progressed.actions.tolist() == theirs.progressed.actions.tolist()
    assert ours.digest == theirs.digest


@pytest.mark.parametrize(("rule", "column"), [("dqn", "replay/allowed_t"), ("sil", "rule/allowed_tm1")])
def test_a_replay_of_an_earlier_version_says_that_all_was_allowed(rule, column):
    first, second = (build_trainer(rule, learning(rule)) for _ in range(2))
    first.train(made_up_episode(0))
    state = first.state()
    assert set(state.pop(column).tolist()) == {31}
    second.restore(state)
    for trainer in (first, second):
        trainer.train(made_up_episode(1))
    ours, theirs = first.state(), second.state()
    assert {name: array.tobytes() for name, array in ours.items()} == {
        name: array.tobytes() for name, array in theirs.items()
    }
