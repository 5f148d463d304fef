"""Compiled twins against torch, against themselves in other batches and processes, and against plain Python."""

import os
import subprocess

import numpy as np
import pytest
import torch

from railctl.common.interpreter import PYTHON
from railctl.common.policy.acting import EpsilonGreedy
from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.packing import KINDS, Layout
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import stream_key

ASSEMBLY = """
import numpy as np
from railctl.common.policy import twin
from railctl.common.policy.packing import Layout
layout = Layout("recurrent", 4, 5, (8, 8))
x, state, out = np.zeros((1, 4), np.float32), np.zeros((1, 16), np.float32), np.zeros((1, 5), np.float32)
twin.forward(layout.header, np.zeros(9999, np.float32), x, state, out)
[text] = twin.forward.inspect_asm().values()
print(text.count("vfm") + text.count("vfnm"), text.count("mulps") > 0)
"""

F, A = 252, 5
LAYERED = [kind for kind in KINDS if kind != "exits"]  # that take any observation; see `test_exits`
HIDDEN = [(128, 128), (32,), (50, 33, 17)]
KEY = stream_key(3, 1, "explore")

# Digests of outputs and choices of all kinds, for processes of their own.
DIGESTS = """
import hashlib, sys
import numpy as np
from railctl.common.policy.compiled import Twin
from railctl.common.policy.packing import KINDS, Layout
rng = np.random.default_rng(1)
np.seterr(over="ignore")
for kind in KINDS:
    n_features = 116 if kind == "exits" else 20
    twin = Twin(Layout(kind, n_features, 5, (16, 9)))
    twin.parameters = rng.normal(size=20_000).astype(np.float32) / 4
    x = (-rng.random((6, n_features)) * (rng.random((6, n_features)) < 0.4)).astype(np.float32)
    state = twin.zero_state(6)
    for step in range(2):
        counters = np.arange(6, dtype=np.uint64) * np.uint64(2)
        choices = twin.act(x, np.full(6, 0.5), np.full(6, 77, np.uint64), counters, state)
        content = b"".join(array.tobytes() for array in choices) + state.tobytes()
        print(kind, hashlib.blake2b(content, digest_size=8).hexdigest())
"""


def make(kind: str, hidden: tuple[int, ...], seed: int = 1, n_actions: int = A):
    """A torch network and its twin, with parameters larger than a fresh network's."""
    if kind == "actor-critic":
        network = build_actor_critic(NetworkConfig(hidden=hidden), F, n_actions, seed)
    elif kind == "recurrent":
        network = build_recurrent_network(NetworkConfig(hidden=hidden), F, n_actions, seed)
    else:
        network = build_network(NetworkConfig(hidden=hidden, kind=kind), F, n_actions, seed)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(torch.randn(parameter.shape, generator=generator) * 0.1)
    twin = Twin(Layout(kind, F, n_actions, hidden))
    twin.load(export_parameters(network))
    return network, twin


def observations(rows: int, seed: int = 0, share: float = 0.2) -> np.ndarray:
    """[rows, F] in [-1, 0], of which `share` are not zero."""
    rng = np.random.default_rng(seed)
    return (-rng.random((rows, F)) * (rng.random((rows, F)) < share)).astype(np.float32)


def torch_outputs(network, kind: str, x: np.ndarray, state=None):
    with torch.inference_mode():
        if kind == "recurrent":
            values, state = network(torch.tensor(x)[None], state)
            return values[0].numpy(), state
        if kind == "actor-critic":
            logits, values = network(torch.tensor(x))
            return torch.cat([logits, values[:, None]], 1).numpy(), None
        return network(torch.tensor(x)).numpy(), None


@pytest.mark.parametrize("kind", LAYERED)
@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_outputs_are_those_of_torch(kind: str, hidden: tuple[int, ...], share: float):
    network, twin = make(kind, hidden)
    state, torch_state = twin.zero_state(64), None
    for step in range(3):
        x = observations(64, step, share)
        ours = twin.outputs(x, state)
        theirs, torch_state = torch_outputs(network, kind, x, torch_state)
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-5)
        best_two = np.sort(theirs[:, :A], axis=1)[:, -2:]
        clear = best_two[:, 1] - best_two[:, 0] > 1e-5
        np.testing.assert_array_equal(ours[clear, :A].argmax(1), theirs[clear, :A].argmax(1))
        assert share == 0 or clear.mean() > 0.9


@pytest.mark.parametrize("kind", LAYERED)
def test_many_actions_fill_several_blocks(kind: str):
    network, twin = make(kind, (16,), n_actions=11)
    x = observations(5)
    np.testing.assert_allclose(twin.outputs(x), torch_outputs(network, kind, x)[0], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("kind", LAYERED)
def test_a_row_does_not_depend_on_the_batch(kind: str):
    _, twin = make(kind, (128, 128))
    x = observations(30)
    state = np.random.default_rng(5).normal(size=(30, twin.layout.n_state)).astype(np.float32)
    state_after = state.copy()
    whole = twin.outputs(x, state_after)
    order = np.random.default_rng(2).permutation(30)
    shuffled = state[order]
    assert twin.outputs(x[order], shuffled).tobytes() == whole[order].tobytes()
    assert shuffled.tobytes() == state_after[order].tobytes()
    raw = np.zeros(F * 4 + 1, np.uint8)[1:].view(np.float32)  # at an odd address
    for row in range(30):
        raw[:] = x[row]
        assert twin.outputs(raw[None], state[row : row + 1].copy()).tobytes() == whole[row].tobytes()


def run_fresh(**variables: str) -> str:
    environment = os.environ | variables
    done = subprocess.run([*PYTHON, "-c", DIGESTS], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_fresh_processes_other_processors_and_plain_python_give_the_same_bits():
    compiled = run_fresh()
    assert len(compiled.splitlines()) == 2 * len(KINDS)
    assert run_fresh(PYTHONHASHSEED="2") == compiled
    assert run_fresh(NUMBA_DISABLE_JIT="1") == compiled
    assert run_fresh(NUMBA_CPU_NAME="x86-64", NUMBA_CPU_FEATURES="+sse2") == compiled


def test_no_fused_multiply_add_is_compiled(tmp_path):
    done = subprocess.run(
        [*PYTHON, "-c", ASSEMBLY],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},  # what comes out of a cache cannot be inspected
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["0", "True"], done.stderr


def test_epsilon_greedy_choices_are_those_of_acting():
    network, twin = make("dueling", (128, 128))
    x = observations(40, 3)
    policy = EpsilonGreedy(F, A)
    counters = np.arange(0, 80, 2, dtype=np.uint64)
    choices = twin.act(x, np.full(40, 0.5), np.full(40, KEY, np.uint64), counters)
    expected = [policy.act(network, row, 0.5, KEY, int(counter)) for row, counter in zip(x, counters, strict=True)]
    assert choices.actions.tolist() == expected
    assert not choices.log_probabilities.any()


def test_an_actor_samples_with_its_probabilities_and_tells_them():
    network, twin = make("actor-critic", (32,))
    x = np.repeat(observations(1, 4), 4000, axis=0)
    counters = np.arange(0, 8000, 2, dtype=np.uint64)
    choices = twin.act(x, np.zeros(4000), np.full(4000, KEY, np.uint64), counters)
    logits = network.logits(torch.tensor(x[:1]))
    expected = torch.softmax(logits, -1)[0].detach().numpy()
    shares = np.bincount(choices.actions, minlength=A) / 4000
    assert (np.abs(shares - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 4000) + 1e-9).all()
    np.testing.assert_allclose(np.exp(choices.log_probabilities), expected[choices.actions], rtol=1e-4)


def test_greedy_choices_are_the_best_outputs():
    for kind in LAYERED:
        _, twin = make(kind, (32,))
        x = observations(20, 5)
        choices = twin.act(x, np.ones(20), np.zeros(20, np.uint64), np.zeros(20, np.uint64), greedy=True)
        np.testing.assert_array_equal(choices.actions, choices.outputs[:, :A].argmax(1))


def test_in_an_episode_every_train_carries_its_own_state():
    _, twin = make("recurrent", (16, 8))
    x = observations(12, 6)
    choose = twin.in_episode(0.0, KEY, twin.zero_state(2))
    state = twin.zero_state(2)
    for step in range(6):
        both = twin.outputs(x[2 * step : 2 * step + 2], state)
        for train in range(2):
            assert choose(x[2 * step + train], step, train).action == both[train].argmax()


def test_what_does_not_fit_is_refused():
    twin = Twin(Layout("plain", F, A, (8,)))
    with pytest.raises(ValueError, match="no parameters"):
        twin.outputs(observations(1))
    _, twin = make("plain", (8,))
    with pytest.raises(ValueError, match=r"not \[R, 252\]"):
        twin.outputs(np.zeros((1, 3), np.float32))
    with pytest.raises(ValueError, match="state has shape"):
        twin.outputs(observations(1), np.zeros((2, 0), np.float32))
    tensors = export_parameters(build_network(NetworkConfig(hidden=(9,)), F, A, 1))
    with pytest.raises(ValueError, match=r"tensor hidden\.0\.weight has shape \(9, 252\), not \(8, 252\)"):
        twin.load(tensors)
    with pytest.raises(KeyError):
        twin.load({})
