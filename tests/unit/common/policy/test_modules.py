"""A module acts as its compiled twin does, on both engines."""

import numpy as np
import pytest
from torch import nn

from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.modules import ModuleChooser
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.player import Acting, network_layout, play, player
from railctl.common.records.acting import digest_of
from railctl.common.rules.settings import NetworkConfig
from railctl.common.world import study_world


def study_player(engine, trains=7, **options):
    """What plays the study's levels."""
    return player(engine, study_world(), "legacy", trains, **options)


def choosers(kind):
    """The module, and its twin."""
    config = NetworkConfig(kind=kind, hidden=(16, 16))
    build = build_actor_critic if kind == "actor-critic" else build_network
    network = build(config, 252, 5, seed=3)
    module = ModuleChooser(build(config, 252, 5, seed=4), 252, 5, is_policy=kind == "actor-critic")
    twin = Twin(network_layout(config, 252))
    for chooser in (module, twin):
        chooser.load(export_parameters(network))
    return module, twin


@pytest.mark.parametrize("kind", ["plain", "dueling", "dueling-apart", "actor-critic"])
def test_a_module_plays_as_its_twin_on_both_engines(kind):
    module, twin = choosers(kind)
    level = LevelSupply().training("easy", 3)
    ours, stepped = (
        play(study_player(engine, 3, has_twin=False), level, Acting(module, epsilon=0.3, key=7))
        for engine in ("compiled", "flatland")
    )
    theirs = play(study_player("compiled", 3), level, Acting(twin, epsilon=0.3, key=7))
    assert digest_of(ours) == digest_of(stepped)
    assert ours.decisions.actions.tolist() == theirs.decisions.actions.tolist()
    np.testing.assert_allclose(ours.decisions.log_probabilities, theirs.decisions.log_probabilities, atol=1e-5)
    np.testing.assert_allclose(ours.decisions.values, theirs.decisions.values, atol=1e-5)
    assert module.is_policy == (kind == "actor-critic") == bool(ours.decisions.values.any())


def test_rows_do_not_depend_on_what_is_beside_them():
    module, _ = choosers("dueling")
    rows = -np.random.default_rng(1).random((9, 252), np.float32)
    together = module.outputs(rows)
    assert together.shape == (9, 5)
    for row, outputs in zip(rows, together, strict=True):
        assert module.outputs(row[None])[0].tobytes() == outputs.tobytes()


def test_what_does_not_fit_is_refused():
    module, _ = choosers("plain")
    with pytest.raises(ValueError, match=r"observations have shape \(2, 7\), not \[R, 252\]"):
        module.outputs(np.zeros((2, 7), np.float32))
    with pytest.raises(ValueError, match=r"state has shape \(1, 3\), not \(1, 0\)"):
        module.outputs(np.zeros((1, 252), np.float32), np.zeros((1, 3), np.float32))
    with pytest.raises(ValueError, match="missing"):
        module.load({})
    with pytest.raises(TypeError, match="ModuleChooser is not compiled: play step by step"):
        play(study_player("compiled", 3), LevelSupply().training("easy", 3), Acting(module))


def test_a_module_of_any_kind_acts():
    module = ModuleChooser(nn.Linear(252, 5), 252, 5, is_policy=False)
    assert module.zero_state(3).shape == (3, 0)
    course = play(
        study_player("compiled", 3, has_twin=False), LevelSupply().training("easy", 3), Acting(module, greedy=True)
    )
    first = module.outputs(course.decisions.observations[:1])[0]
    assert course.decisions.actions[0] == first.argmax()
