"""A network as one flat float32 array and a small header of integers: the form that compiled code reads.

The parameters are those of the torch networks, by their names there. Weights are stored transposed, a row an input,
so that an input of zero leaves out a whole row. The heads of a stack lie side by side in one layer, its width rounded
up to whole blocks with zeros. In order:

| kind | parameters |
|---|---|
| plain | hidden layers, head of action values |
| dueling | hidden layers, head of V and advantages |
| dueling-apart | the advantages' hidden layers, their head, V's hidden layers, its head |
| actor-critic | the actor's hidden layers, head of logits, the critic's hidden layers, head of V |
| recurrent | weights of the LSTM's inputs, of its hidden state, two biases, then hidden layers and head as dueling |
| exits | exit, row, query, shared hidden layers, head of one exit's logit, pooled, head of the other logits and V |

A layer is its weights [in, out] and its biases [out]. The header is `kind, F, A, number of hidden widths, widths...`;
for recurrent networks the first width is the LSTM's.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.exit_layers import Layer, exit_layers
from railctl.common.policy.flat import Arrays, Order, Place, even

Kind = Literal["plain", "dueling", "actor-critic", "recurrent", "exits", "dueling-apart"]
PLAIN, DUELING, ACTOR_CRITIC, RECURRENT, EXITS, DUELING_APART = range(6)
KINDS: dict[Kind, int] = {
    "plain": PLAIN,
    "dueling": DUELING,
    "actor-critic": ACTOR_CRITIC,
    "recurrent": RECURRENT,
    "exits": EXITS,
    "dueling-apart": DUELING_APART,
}
POLICIES = ("actor-critic", "exits")  # kinds whose outputs are logits and the state's value
BLOCK = 8  # columns of a head that are summed together; a head's width is a multiple of it
HEADER_WIDTHS = 4  # where the widths begin in the header
GATES = 4  # of an LSTM: input, forget, cell, output


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
        return self.n_actions + (self.kind in POLICIES)

    @property
    def n_state(self) -> int:
        """Numbers that a train carries from one decision to the next: an LSTM's hidden state, then its cell state."""
        return 2 * self.hidden[0] if self.kind == "recurrent" else 0

    @property
    def header(self) -> NDArray[np.int64]:
        fields = [KINDS[self.kind], self.n_features, self.n_actions, len(self.hidden), *self.hidden]
        return np.array(fields, dtype=np.int64)

    @cached_property
    def order(self) -> Order:
        """The order of the table above."""
        hidden, features, places = self.hidden, self.n_features, _Places()
        if self.kind == "exits":
            places.add_exits(exit_layers(hidden))
        elif self.kind in ("actor-critic", "dueling-apart"):
            actions, state = ("actor", "critic") if self.kind == "actor-critic" else ("advantage", "value")
            for part, width in {actions: self.n_actions, state: 1}.items():
                places.add_stack(f"{part}_hidden", (features, *hidden))
                places.add_layer(hidden[-1], {part: width}, padded(width))
        else:
            if self.kind == "recurrent":
                places.add_cell(features, hidden[0])
            places.add_stack("hidden", hidden if self.kind == "recurrent" else (features, *hidden))
            heads = {"q": self.n_actions} if self.kind == "plain" else {"value": 1, "advantage": self.n_actions}
            places.add_layer(hidden[-1], heads, padded(sum(heads.values())))
        return Order(even(places.end), places.found)

    def pack(self, tensors: Arrays) -> NDArray[np.float32]:
        """The parameters in their order; raises as `Order.pack`."""
        return self.order.pack(tensors)


def padded(width: int) -> int:
    """The least multiple of `BLOCK` that holds a head of `width`."""
    return -(-width // BLOCK) * BLOCK


class _Places:
    """Parameters, each behind those before it."""

    def __init__(self) -> None:
        self.found: dict[str, Place] = {}
        self.end = 0

    def add_stack(self, name: str, widths: Sequence[int]) -> None:
        """The layers between these widths."""
        for layer, (n_in, n_out) in enumerate(itertools.pairwise(widths)):
            self.add_layer(n_in, {f"{name}.{layer}": n_out}, n_out)

    def add_layer(self, n_in: int, parts: dict[str, int], width: int) -> None:
        """The weights of parts of a layer side by side, filled up to a width, then their biases."""
        begin, biases = self.end, self.end + n_in * width
        for name, n_out in parts.items():
            self.found[f"{name}.weight"] = Place.counted((n_out, n_in), begin, (1, width))
            self.found[f"{name}.bias"] = Place.counted((n_out,), biases, (1,))
            begin, biases = begin + n_out, biases + n_out
        self.end += (n_in + 1) * width

    def add_exits(self, layers: Sequence[Layer]) -> None:
        """The layers of a network of exits, its heads filled up to whole blocks."""
        *body, stay, value = layers
        for name, n_in, n_out in body:
            self.add_layer(n_in, {name: n_out}, padded(n_out) if name == "move" else n_out)
        self.add_layer(stay.n_in, {part.name: part.n_out for part in (stay, value)}, padded(stay.n_out + value.n_out))

    def add_cell(self, n_in: int, width: int) -> None:
        """An LSTM."""
        gates = GATES * width
        for name, rows in {"weight_ih_l0": n_in, "weight_hh_l0": width}.items():
            self.found[f"lstm.{name}"] = Place.counted((gates, rows), self.end, (1, gates))
            self.end += rows * gates
        for name in ("bias_ih_l0", "bias_hh_l0"):
            self.found[f"lstm.{name}"] = Place.counted((gates,), self.end, (1,))
            self.end += gates
