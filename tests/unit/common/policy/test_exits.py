"""The network of exits: its twin beside torch, what it may depend on, and that it learns."""

import numpy as np
import pytest
import torch

from railctl.common.config import parse_config
from railctl.common.levels.shipped import generate
from railctl.common.policy.compiled import Twin
from railctl.common.policy.exit_layers import NO_EXIT
from railctl.common.policy.exits import ExitsNetwork, build_exits
from railctl.common.policy.networks import export_parameters
from railctl.common.policy.packing import Layout
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.traffic_shape import EXITS_END, N_EXIT, N_EXITS, N_OTHER, N_ROW, N_TRAIN
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, N_ACTIONS
from railctl.common.rules.settings import NetworkConfig
from railctl.common.strict import ConfigError
from railctl.services.learner.learning import Learning
from railctl.services.learner.policy_training import build_network
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.textbook.policies import PolicyNetwork

HIDDEN = [(16,), (24, 16), (9, 20, 12)]


def make(hidden: tuple[int, ...], others: int) -> tuple[ExitsNetwork, Twin]:
    """A network with parameters larger than a fresh one's, and its twin."""
    n_features = TrafficObservation(others=others).n_features()
    network = build_exits(NetworkConfig(kind="exits", hidden=hidden), n_features, N_ACTIONS, seed=1)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(torch.randn(parameter.shape, generator=generator) * 0.2)
    twin = Twin(Layout("exits", n_features, N_ACTIONS, hidden))
    twin.load(export_parameters(network))
    return network, twin


def seen(others: int) -> np.ndarray:
    """[R, F]: what trains see in a random episode, and what one sees that has arrived."""
    world, rng = CompiledWorld(1, 7, observation=TrafficObservation(others=others)), np.random.default_rng(others)
    world.load(0, generate("hard", 3))
    vectors = [np.zeros((1, world.n_features), np.float32)]
    for _ in range(40):
        vectors.append(world.observe_deciding()[1])
        world.step(rng.choice(5, p=[0.05, 0.1, 0.7, 0.1, 0.05], size=(1, 7)).astype(np.int8))
    return np.concatenate(vectors)


def by_torch(network: ExitsNetwork, x: np.ndarray) -> np.ndarray:
    with torch.inference_mode():
        logits, values = network(torch.tensor(x))
    return torch.cat([logits, values[:, None]], 1).numpy()


@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("others", [1, 6])
def test_outputs_are_those_of_torch(hidden: tuple[int, ...], others: int):
    network, twin = make(hidden, others)
    x = seen(others)
    ours = twin.outputs(x)
    np.testing.assert_allclose(ours, by_torch(network, x), rtol=1e-5, atol=1e-5)
    exits = x[:, N_TRAIN:EXITS_END].reshape(-1, N_EXITS, N_EXIT)[..., 0]
    np.testing.assert_array_equal(ours[:, MOVE_LEFT : MOVE_LEFT + N_EXITS] == NO_EXIT, exits == 0)
    assert len(np.unique(exits, axis=0)) >= 4  # no exit, one, several
    assert (x[:, EXITS_END::N_ROW].sum(1) > 0).any()


def test_the_order_of_rows_and_the_side_of_an_exit_do_not_matter():
    network, twin = make((16,), 6)
    x = seen(6)
    there = x[:, EXITS_END::N_ROW].sum(1) == 6
    assert there.sum() > 10
    turned = x.copy()
    turned[:, EXITS_END:] = x[:, EXITS_END:].reshape(len(x), 6, N_ROW)[:, ::-1].reshape(len(x), -1)
    np.testing.assert_allclose(twin.outputs(turned[there]), twin.outputs(x[there]), atol=1e-5)
    mirrored = x.copy()
    mirrored[:, N_TRAIN:EXITS_END] = x[:, N_TRAIN:EXITS_END].reshape(len(x), 3, N_EXIT)[:, ::-1].reshape(len(x), -1)
    rows = mirrored[:, EXITS_END:].reshape(len(x), 6, N_ROW)
    rows[:, :, N_OTHER:] = rows[:, :, N_OTHER:].reshape(len(x), 6, 3, -1)[:, :, ::-1].reshape(len(x), 6, -1)
    np.testing.assert_allclose(by_torch(network, mirrored), by_torch(network, x)[:, [0, 3, 2, 1, 4, 5]], atol=1e-5)
    np.testing.assert_allclose(twin.outputs(mirrored), twin.outputs(x)[:, [0, 3, 2, 1, 4, 5]], atol=1e-5)


def test_a_meeting_matters_to_its_exit_and_to_staying():
    _, twin = make((16,), 6)
    x = seen(6)
    forward = N_TRAIN + (MOVE_FORWARD - MOVE_LEFT) * N_EXIT
    left = x[(x[:, EXITS_END] == 1) & (x[:, N_TRAIN] == 1) & (x[:, forward] == 1)]
    changed = left.copy()
    changed[:, EXITS_END + N_OTHER] += 0.5  # of the first other train, behind the left exit
    moved = (np.abs(twin.outputs(changed) - twin.outputs(left)) > 1e-6).mean(0)
    assert moved[[0, 1, 4, 5]].min() > 0.9
    assert moved[[2, 3]].max() == 0


def test_a_row_does_not_depend_on_the_batch():
    _, twin = make((24, 16), 6)
    x = seen(6)
    whole = twin.outputs(x)
    for row in range(0, len(x), 7):
        assert twin.outputs(x[row : row + 1]).tobytes() == whole[row].tobytes()


def test_first_weights_are_a_function_of_the_seed():
    one, same, other = (build_exits(NetworkConfig(hidden=(8,)), 116, N_ACTIONS, seed) for seed in (1, 1, 2))
    for name, array in export_parameters(one).items():
        np.testing.assert_array_equal(array, export_parameters(same)[name])
    assert (export_parameters(one)["row.weight"] != export_parameters(other)["row.weight"]).any()
    assert np.abs(by_torch(one, seen(1))[1:, [0, 4]]).max() < 0.05  # the first policy is nearly uniform


def config_of(**changed: object) -> dict[str, object]:
    return {
        "algorithm": "any",
        "rule": "ppo",
        "mix": {"easy": 1.0},
        "episodes": 3,
        "network": {"kind": "exits", "hidden": [8, 8]},
        "observation": {"kind": "traffic", "others": 2},
        "ppo": {"learning_rate": 0.01, "epochs": 1},
        "cluster": {"actors": {"any": 1}},
        **changed,
    }


def test_it_learns_by_autograd_what_its_twin_acts_with():
    config = parse_config(config_of())
    assert config.learning.learns_with_torch
    n_features = config.world.n_features
    network = build_network(Learning(1, 2, config.learning, n_features), 0.01, 0.5)
    assert isinstance(network, PolicyNetwork)
    twin = Twin(Layout("exits", n_features, N_ACTIONS, (8, 8)))
    x = seen(2)[1:]
    forward = []
    for _ in range(20):
        twin.load(network.weights())
        outputs = twin.outputs(x)
        logits, value = network.outputs(sparse_rows(x))
        np.testing.assert_allclose(logits.detach(), outputs[:, :N_ACTIONS], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(value.detach(), outputs[:, N_ACTIONS], rtol=1e-5, atol=1e-5)
        chances = torch.log_softmax(logits, -1)[:, MOVE_FORWARD]
        forward.append(chances.exp().mean().item())
        network.descend(-chances.mean() + (value - 0.5).square().mean())
    assert forward[-1] > forward[0] + 0.2
    assert abs(outputs[:, N_ACTIONS] - 0.5).mean() < 0.2


def test_it_needs_the_traffic():
    with pytest.raises(
        ConfigError, match=r"network\.kind exits: it has no use for a tree observation, make it traffic"
    ):
        parse_config(config_of(observation={"kind": "tree"}))
