"""The networks that runs begin with, in plain arrays: a function of the seed alone, on every machine.

Names and shapes are those of the modules of torch, which take these weights over (`networks`, `actor_critic`,
`recurrent`). Torch's own draws differ from one kind of processor to another, and importing it takes seconds.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.exit_layers import exit_layers
from railctl.common.policy.orthogonal import orthogonal
from railctl.common.policy.packing import GATES
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import stream_key

Weights = dict[str, NDArray[np.float32]]
Shape = tuple[int, ...]

HIDDEN_GAIN, ACTOR_GAIN, CRITIC_GAIN = math.sqrt(2), 0.01, 1.0


class FirstNetwork(NamedTuple):
    """A network before it has learned anything.

    Attributes:
        n_features: F.
        n_actions: A.
        config: its kind and widths.
        weights: by the names of the module's parameters, in the order of its definition.
    """

    n_features: int
    n_actions: int
    config: NetworkConfig
    weights: Weights


def first_values(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> FirstNetwork:
    """That of a `QNetwork`.

    Uniform in +-1/sqrt(n_in): PyTorch's own default, there written as Kaiming-uniform (He et al. 2015) with
    a = sqrt(5), a bound of sqrt(6 / ((1 + a^2) n_in)).
    """
    rng = np.random.Generator(np.random.Philox(key=stream_key(seed, 0, "network")))
    widths = (n_features, *config.hidden)
    if config.kind == "dueling-apart":
        layers = _apart(widths, {"advantage": n_actions, "value": 1})
    else:
        heads = {"value": 1, "advantage": n_actions} if config.kind == "dueling" else {"q": n_actions}
        layers = [*_named("hidden", widths), *((name, widths[-1], width) for name, width in heads.items())]
    return FirstNetwork(n_features, n_actions, config, _uniform_layers(layers, rng))


def first_actor_critic(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> FirstNetwork:
    """That of an `ActorCritic`: orthogonal, with the gains that it names; biases are zero."""
    gains = {"actor": ACTOR_GAIN, "critic": CRITIC_GAIN}
    apart = _apart((n_features, *config.hidden), {"actor": n_actions, "critic": 1})
    layers = [(*layer, gains.get(layer[0], HIDDEN_GAIN)) for layer in apart]
    return FirstNetwork(n_features, n_actions, config, _orthogonal_layers(layers, seed))


def first_exits(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> FirstNetwork:
    """That of an `ExitsNetwork`: as that of an `ActorCritic`."""
    gains = {"move": ACTOR_GAIN, "stay": ACTOR_GAIN, "value": CRITIC_GAIN}
    layers = [(*layer, gains.get(layer.name, HIDDEN_GAIN)) for layer in exit_layers(config.hidden)]
    return FirstNetwork(n_features, n_actions, config, _orthogonal_layers(layers, seed))


def first_recurrent(config: NetworkConfig, n_features: int, n_actions: int, seed: int) -> FirstNetwork:
    """That of a `RecurrentQNetwork`, by PyTorch's default laws.

    Uniform in +-1/sqrt(n_in) for linear layers, and in +-1/sqrt(width) for the LSTM.
    """
    rng = np.random.Generator(np.random.Philox(key=stream_key(seed, 0, "recurrent-network")))
    units, last = config.hidden[0], config.hidden[-1]
    gates = GATES * units
    shapes: dict[str, Shape] = {
        "lstm.weight_ih_l0": (gates, n_features),
        "lstm.weight_hh_l0": (gates, units),
        "lstm.bias_ih_l0": (gates,),
        "lstm.bias_hh_l0": (gates,),
    }
    weights = {name: _uniform(shape, units, rng) for name, shape in shapes.items()}
    layers = [*_named("hidden", config.hidden), ("value", last, 1), ("advantage", last, n_actions)]
    return FirstNetwork(n_features, n_actions, config, weights | _uniform_layers(layers, rng))


def _named(name: str, widths: Sequence[int]) -> Iterator[tuple[str, int, int]]:
    """The layers of a stack: name, inputs, outputs."""
    return ((f"{name}.{number}", *pair) for number, pair in enumerate(itertools.pairwise(widths)))


def _apart(widths: Sequence[int], heads: Mapping[str, int]) -> list[tuple[str, int, int]]:
    """The layers of stacks that share nothing, each with a head of its own."""
    stacks = {head: _named(f"{head}_hidden", widths) for head in heads}
    return [layer for head, width in heads.items() for layer in (*stacks[head], (head, widths[-1], width))]


def _orthogonal_layers(layers: Sequence[tuple[str, int, int, float]], seed: int) -> Weights:
    """Of layers' names, inputs, outputs and gains."""
    weights: Weights = {}
    for index, (name, n_in, n_out, gain) in enumerate(layers):
        weights[f"{name}.weight"] = orthogonal(n_out, n_in, gain, stream_key(seed, index, "orthogonal"))
        weights[f"{name}.bias"] = np.zeros(n_out, np.float32)
    return weights


def _uniform_layers(layers: Sequence[tuple[str, int, int]], rng: np.random.Generator) -> Weights:
    weights: Weights = {}
    for name, n_in, n_out in layers:
        weights[f"{name}.weight"] = _uniform((n_out, n_in), n_in, rng)
        weights[f"{name}.bias"] = _uniform((n_out,), n_in, rng)
    return weights


def _uniform(shape: Shape, fan: int, rng: np.random.Generator) -> NDArray[np.float32]:
    drawn = 1 / math.sqrt(fan) * (2 * rng.random(shape) - 1)
    return drawn.astype(np.float32)
