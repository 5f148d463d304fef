"""Where a network's parameters lie in flat arrays of float32, and what training changes of them.

Layer after layer, weights [in, out], then biases [out], every width filled up to a multiple of 16. What fills up is
zero and stays so: it gets no gradient. The heads over the same hidden layers are one layer, side by side. An LSTM may
stand in place of the first layer, see `recurrent`.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.flat import Flat, Order
from railctl.common.policy.named import copies, overwrite
from railctl.common.policy.packing import GATES, Layout
from railctl.services.learner.fused.tile import WIDTH

VALUES, GRADIENT, MEAN, SQUARE, TARGET = range(5)  # rows of `Training.arrays`


class Packed:
    """One stack of layers: hidden ones, `hidden`.0 and so on, and heads over the last.

    Attributes:
        widths: F, then those of the layers, filled up.
        length: the number of parameters, with what fills up.
        input_width: how many weights an input has; those of the inputs come first.
        first_length: the number of the first layer's parameters.
    """

    def __init__(self, n_features: int, hidden: Mapping[str, Sequence[int]], heads: Mapping[str, int]) -> None:
        """`hidden` holds the widths by the layers' common name; `heads` their widths by theirs."""
        [(self._name, widths)] = hidden.items()
        self._real = (n_features, *widths)
        self._heads = dict(heads)
        self.widths = np.array([n_features, *map(filled, (*widths, sum(heads.values())))], np.int64)
        self.input_width = int(self.widths[1])
        self.first_length = (n_features + 1) * self.input_width
        self.length = self._length()

    def named(self, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Views of an array [length], with the names and shapes that the parameters have in the module of torch."""
        found = self._first(flat)
        start = self.first_length
        for layer, (n_in, n_out) in enumerate(itertools.pairwise(self.widths[1:]), 1):
            stop = start + int((n_in + 1) * n_out)
            found |= self._layer(layer, flat[start:stop])
            start = stop
        return found

    def _length(self) -> int:
        return self.first_length + int(sum((n_in + 1) * n_out for n_in, n_out in itertools.pairwise(self.widths[1:])))

    def _first(self, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Of the first layer."""
        return self._layer(0, flat[: self.first_length])

    def _layer(self, layer: int, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        n_in, n_out = self.widths[layer : layer + 2]
        weight, bias = flat[: n_in * n_out].reshape(n_in, n_out), flat[n_in * n_out :]
        found: dict[str, NDArray[np.float32]] = {}
        column = 0
        for name, width in self._parts(layer).items():
            found[f"{name}.weight"] = weight[: self._real[layer], column : column + width].T
            found[f"{name}.bias"] = bias[column : column + width]
            column += width
        return found

    def _parts(self, layer: int) -> dict[str, int]:
        """The names and widths of what lies side by side in a layer."""
        if layer == len(self._real) - 1:
            return self._heads
        return {self._named(layer): self._real[layer + 1]}

    def _named(self, layer: int) -> str:
        return f"{self._name}.{layer}"


class PackedRecurrent(Packed):
    """An LSTM, `lstm`, then a stack whose layers count from there."""

    def __init__(self, n_features: int, hidden: Mapping[str, Sequence[int]], heads: Mapping[str, int]) -> None:
        """The first of the hidden widths is the LSTM's."""
        super().__init__(n_features, hidden, heads)
        self._gates = GATES * self._real[1]
        self.input_width = filled(self._gates)
        self.first_length = int(n_features + self.widths[1] + 2) * self.input_width
        self.length = self._length()

    def _first(self, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        table = flat[: self.first_length].reshape(-1, self.input_width)[:, : self._gates]
        n_features, units, end = self._real[0], self._real[1], len(table)
        parts = {
            "weight_ih_l0": table[:n_features].T,
            "weight_hh_l0": table[n_features : n_features + units].T,
            "bias_ih_l0": table[end - 2],
            "bias_hh_l0": table[end - 1],
        }
        return {f"lstm.{name}": part for name, part in parts.items()}

    def _named(self, layer: int) -> str:
        return super()._named(layer - 1)


def filled(width: int) -> int:
    """The least multiple of 16 that holds a width."""
    return -(-width // WIDTH) * WIDTH


class Training:
    """Stacks with all that training changes: parameters, gradients, Adam's moments, and perhaps a target network.

    Attributes:
        arrays: [4 or 5, P], all stacks' parameters one behind the other; see the constants above.
        seen: [F], which inputs were ever other than zero. The weights of others have no moments.
    """

    def __init__(
        self,
        weights: Mapping[str, NDArray[np.float32]],
        stacks: Sequence[Packed],
        layout: Layout,
        *,
        has_target: bool = False,
    ) -> None:
        """The parameters start as a copy of `weights`; so does the target. `layout` is that of the twin."""
        self._stacks = stacks
        self.arrays = np.zeros((4 + has_target, sum(stack.length for stack in stacks)), np.float32)
        self.seen = np.zeros(int(stacks[0].widths[0]), np.bool_)
        self._steps = np.zeros((), np.float32)
        for row in (VALUES, TARGET)[: 1 + has_target]:
            overwrite(self._named(self.arrays[row]), weights)
        self._order = layout.order
        self._pieces = pieces(self._named(np.arange(self.arrays.shape[1], dtype=np.int32)), self._order)

    @property
    def steps(self) -> int:
        """Steps that Adam has made."""
        return int(self._steps)

    @steps.setter
    def steps(self, steps: int) -> None:
        self._steps[()] = steps

    def follow(self, share: float) -> None:
        """Move the target network, which there is, a share towards the one that learns."""
        follow(self.arrays[TARGET], self.arrays[VALUES], np.float32(share))

    def weights(self) -> Flat:
        """A copy of the parameters, by their names in the module of torch, in the order of the twin."""
        flat = np.empty(self._order.size, np.float32)
        carry(self.arrays[VALUES], self._pieces, flat)
        return Flat(self._order, flat)

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that training changes: `network/*`, `target/*`, `steps`, `exp_avg/*` and `exp_avg_sq/*`."""
        return copies(self._arrays())

    def restore(self, state: Mapping[str, NDArray[np.float32]]) -> None:
        """Take on a `state`: all that follows is the same to the bit.

        Raises:
            ValueError: naming the tensor that does not fit; then nothing has changed.
        """
        overwrite(self._arrays(), state)
        self.arrays[GRADIENT] = 0
        self.seen[:] = False
        start = 0
        for stack in self._stacks:
            first = self.arrays[:, start : start + int(stack.widths[0]) * stack.input_width]
            by_input = first.reshape(len(self.arrays), len(self.seen), -1)
            self.seen |= (by_input[[MEAN, SQUARE]] != 0).any((0, 2))
            if len(self.arrays) > TARGET:
                self.seen |= (by_input[TARGET] != by_input[VALUES]).any(1)
            start += stack.length

    def _named(self, flat: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Views of an array [P]."""
        found: dict[str, NDArray[Any]] = {}
        start = 0
        for stack in self._stacks:
            found |= stack.named(flat[start : start + stack.length])
            start += stack.length
        return found

    def _arrays(self) -> dict[str, NDArray[np.float32]]:
        networks = {"network": VALUES} | ({"target": TARGET} if len(self.arrays) > TARGET else {})
        steps = {"steps": self._steps}
        return self._by_part(networks) | steps | self._by_part({"exp_avg": MEAN, "exp_avg_sq": SQUARE})

    def _by_part(self, rows: Mapping[str, int]) -> dict[str, NDArray[np.float32]]:
        parts = {part: self._named(self.arrays[row]) for part, row in rows.items()}
        return {f"{part}/{name}": array for part, arrays in parts.items() for name, array in arrays.items()}


def pieces(places: Mapping[str, NDArray[np.int32]], order: Order) -> NDArray[np.int64]:
    """How to bring parameters into an `order`, from the `places` where they lie in another array.

    Returns:
        [pieces, 2], one behind the other: where a piece comes from, -1 for zeros, and its length.
    """
    sources = np.full(order.size, -1, np.int32)
    for name, view in order.views(sources).items():
        view[...] = places[name]
    follows = np.where(sources[:-1] < 0, sources[1:] < 0, sources[1:] == sources[:-1] + 1)
    begins = np.concatenate(([0], 1 + np.flatnonzero(~follows)))
    return np.stack((sources[begins].astype(np.int64), np.diff(begins, append=order.size)), 1)


@bare_kernel
def follow(target: NDArray[np.float32], online: NDArray[np.float32], share: np.float32) -> None:
    """Move `target` [n] a share towards `online`."""
    for i in range(len(target)):
        target[i] += share * (online[i] - target[i])


@bare_kernel
def carry(values: NDArray[np.float32], pieces: NDArray[np.int64], out: NDArray[np.float32]) -> None:
    """Fill `out` with pieces of `values`."""
    at = 0
    for piece in range(len(pieces)):
        source, length = pieces[piece, 0], pieces[piece, 1]
        part = out[at : at + length]
        if source < 0:
            for k in range(length):
                part[k] = 0
        else:
            taken = values[source : source + length]
            for k in range(length):
                part[k] = taken[k]
        at += length
