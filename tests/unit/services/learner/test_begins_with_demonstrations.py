"""The demonstrations that a replay begins with."""

import json

import numpy as np
import pytest
from demonstrated import WORLD, course

from railctl.common.demonstrations import digest_of_file, write_demonstrations
from railctl.deploy.launch import new_run
from railctl.deploy.resolve import resolve
from railctl.services.learner.learning import build_trainer, learning_of
from railctl.services.learner.returns import decision_returns
from railctl.services.learner.start import demonstrations_of

PLAIN = {"algorithm": "sil", "level": "easy", "cluster": {"cores": 1}}


@pytest.fixture
def folder(tmp_path):
    """That of a run which begins with two episodes of two decisions each."""
    write_demonstrations(tmp_path / "some.demos", WORLD, "somebody", 2, map(course, range(2)))
    config = resolve(PLAIN | {"demonstrations": "some.demos"}, tmp_path)
    return new_run("some", config, tmp_path / "runs", base=tmp_path)


def test_they_are_in_the_replay_as_decisions_like_all_others(folder):
    config = folder.config()
    with_them = build_trainer("sil", learning_of(config, None, demonstrations_of(folder, config)))
    without = build_trainer("sil", learning_of(resolve(PLAIN)))
    state = with_them.state()
    assert state["rule/action_tm1"].tolist() == [2, 4, 2, 4]
    returns = decision_returns(course(), np.full(2, -1, np.float32), config.learning.discount)
    assert state["rule/return_t"][0] == returns[0]  # of a train that arrives
    np.testing.assert_array_equal(state["rule/least_return_t"], np.tile(returns, 2))
    assert without.state()["rule/action_tm1"].tolist() == []
    for name, array in without.weights().items():
        np.testing.assert_array_equal(with_them.weights()[name], array)


def test_what_turned_out_better_is_drawn_before_the_rest(folder):
    config = folder.config()
    state = build_trainer("sil", learning_of(config, None, demonstrations_of(folder, config))).state()
    arriving, stopped = state["rule/priorities"][:2]
    assert arriving > stopped


def test_a_trainer_that_is_restored_has_them_once(folder):
    config = folder.config()
    first, second = (build_trainer("sil", learning_of(config, None, demonstrations_of(folder, config))) for _ in "12")
    second.restore(first.state())
    assert len(second.state()["rule/action_tm1"]) == 4


def test_a_copy_of_another_version_is_refused_as_whatever_a_learner_cannot_begin_with(folder):
    copy, config = folder.demonstrations_file, folder.config()
    first, rest = copy.read_bytes().split(b"\n", 1)
    copy.write_bytes(json.dumps(json.loads(first) | {"schema_version": 4}).encode() + b"\n" + rest)
    given = config.learning.demonstrations.model_copy(update={"digest": digest_of_file(copy)})
    config = config.model_copy(update={"learning": config.learning.model_copy(update={"demonstrations": given})})
    with pytest.raises(ValueError, match="its schema is 4"):
        list(demonstrations_of(folder, config))


def test_another_copy_is_refused(folder):
    config = folder.config()
    folder.demonstrations_file.unlink()
    write_demonstrations(folder.demonstrations_file, WORLD, "somebody", 1, [course()])
    with pytest.raises(ValueError, match="is not what the run began with: restore it"):
        list(demonstrations_of(folder, config))
    folder.demonstrations_file.unlink()
    with pytest.raises(ValueError, match="No such file or directory: restore it"):
        list(demonstrations_of(folder, config))
