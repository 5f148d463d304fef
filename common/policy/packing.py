"""A network as one flat float32 array and a small header of integers: the form that compiled code reads.

The parameters are those of the torch networks, by their names there. Weights are stored transposed, a row an input,
so that an input of zero leaves out a whole row. The heads of a stack lie side by side in one layer, its width rounded
up to whole blocks with zeros. In order:

| kind | parameters |
|---|---|
| plain | hidden layers, head of action values |
| dueling | hidden layers, head of V and advantages |
| actor-critic | the actor's hidden layers, head of logits, the critic's hidden layers, head of V |
| recurrent | weights of the LSTM's inputs, of its hidden state, one bias, then hidden layers and head as dueling |

A layer is its weights [in, out] and its biases [out]. The header is `kind, F, A, number of hidden widths, widths...`;
for recurrent networks the first width is the LSTM's.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["plain", "dueling", "actor-critic", "recurrent"]
PLAIN, DUELING, ACTOR_CRITIC, RECURRENT = range(4)
KINDS: dict[Kind, int] = {"plain": PLAIN, "dueling": DUELING, "actor-critic": ACTOR_CRITIC, "recurrent": RECURRENT}
BLOCK = 8  # columns of a head that are summed together; a head's width is a multiple of it
HEADER_WIDTHS = 4  # where the widths begin in the header
GATES = 4  # of an LSTM: input, forget, cell, output

Arrays = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Layout:
    """What a network is made of, apart from its parameters."""

    kind: Kind
    n_features: int
    n_actions: int
    hidden: tuple[int, ...]

    @property
    def n_outputs(self) -> int:
        """Numbers a row: action values, or logits and the state's value."""
        return self.n_actions + (self.kind == "actor-critic")

    @property
    def n_state(self) -> int:
        """Numbers that a train carries from one decision to the next: an LSTM's hidden state, then its cell state."""
        return 2 * self.hidden[0] if self.kind == "recurrent" else 0

    @property
    def header(self) -> NDArray[np.int64]:
        fields = [KINDS[self.kind], self.n_features, self.n_actions, len(self.hidden), *self.hidden]
        return np.array(fields, dtype=np.int64)

    def pack(self, tensors: Arrays, room: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """The parameters in the order of the table above, in the `room` of earlier ones if they are as many.

        Raises:
            KeyError: a parameter is missing.
            ValueError: one has another shape than this layout says.
        """
        hidden, features = self.hidden, self.n_features
        parts: list[NDArray[np.float32]] = []
        if self.kind == "actor-critic":
            parts += _stack(tensors, "actor_hidden", (features, *hidden))
            parts += _head(tensors, {"actor": self.n_actions}, hidden[-1])
            parts += _stack(tensors, "critic_hidden", (features, *hidden))
            parts += _head(tensors, {"critic": 1}, hidden[-1])
        else:
            if self.kind == "recurrent":
                parts += _cell(tensors, features, hidden[0])
            parts += _stack(tensors, "hidden", hidden if self.kind == "recurrent" else (features, *hidden))
            heads = {"q": self.n_actions} if self.kind == "plain" else {"value": 1, "advantage": self.n_actions}
            parts += _head(tensors, heads, hidden[-1])
        flat = [np.ascontiguousarray(part, np.float32).ravel() for part in parts]
        fits = room is not None and len(room) == sum(map(len, flat))
        return np.concatenate(flat, out=room if fits else None)


def padded(width: int) -> int:
    """The least multiple of `BLOCK` that holds a head of `width`."""
    return -(-width // BLOCK) * BLOCK


def _tensor(tensors: Arrays, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    array = tensors[name]
    if array.shape != shape:
        raise ValueError(f"tensor {name} has shape {array.shape}, not {shape}")
    return array


def _stack(tensors: Arrays, name: str, widths: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """Weights and biases of the layers between these widths."""
    parts = []
    for layer, (n_in, n_out) in enumerate(itertools.pairwise(widths)):
        parts += [
            _tensor(tensors, f"{name}.{layer}.weight", (n_out, n_in)).T,
            _tensor(tensors, f"{name}.{layer}.bias", (n_out,)),
        ]
    return parts


def _head(tensors: Arrays, widths: dict[str, int], n_in: int) -> list[NDArray[np.float32]]:
    """The weights and biases of several heads as one padded layer."""
    n_out = sum(widths.values())
    weights = np.zeros((n_in, padded(n_out)), np.float32)
    biases = np.zeros(padded(n_out), np.float32)
    at = 0
    for name, n in widths.items():
        weights[:, at : at + n] = _tensor(tensors, f"{name}.weight", (n, n_in)).T
        biases[at : at + n] = _tensor(tensors, f"{name}.bias", (n,))
        at += n
    return [weights, biases]


def _cell(tensors: Arrays, n_in: int, width: int) -> list[NDArray[np.float32]]:
    """An LSTM's weights, with its two biases, which are only ever added, as one."""
    gates = GATES * width
    bias = _tensor(tensors, "lstm.bias_ih_l0", (gates,)) + _tensor(tensors, "lstm.bias_hh_l0", (gates,))
    return [
        _tensor(tensors, "lstm.weight_ih_l0", (gates, n_in)).T,
        _tensor(tensors, "lstm.weight_hh_l0", (gates, width)).T,
        bias,
    ]
