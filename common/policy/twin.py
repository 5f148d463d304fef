# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The compiled twins of the torch networks: forward passes of one observation after the other; see `layers`."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.policy.arithmetic import sigmoid, tanh
from railctl.common.policy.exits_twin import exits_room, forward_exits
from railctl.common.policy.layers import add_rows, nonzeros, perceptron
from railctl.common.policy.packing import (
    ACTOR_CRITIC,
    BLOCK,
    DUELING,
    DUELING_APART,
    EXITS,
    GATES,
    HEADER_WIDTHS,
    RECURRENT,
)

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_ZERO = np.float32(0)


@bare_kernel
def workspace_size(header: _Ints) -> int:
    """The length of each of the three arrays (places, values, sums) that a forward pass of this network works in."""
    if header[0] == EXITS:
        return exits_room(header)
    widest = max(header[1], header[2] + BLOCK)
    for width in header[HEADER_WIDTHS:]:
        widest = max(widest, width * (GATES if header[0] == RECURRENT else 1))
    return int(widest) + 1


@bare_kernel
def join_heads(value: np.float32, advantages: _Floats, out: _Floats) -> None:
    """Action values [A] from V and the advantages [at least A], which may be `out`: `Q = V + A - mean(A)`."""
    total = _ZERO
    for action in range(len(out)):
        total += advantages[action]
    mean = total / np.float32(len(out))
    for action in range(len(out)):
        out[action] = (value + advantages[action]) - mean


@bare_kernel
def gates(sums: _Floats, state: _Floats) -> None:
    """One step of an LSTM (Hochreiter & Schmidhuber 1997, with the forget gate of Gers et al. 2000).

    Args:
        sums: [4 H], what goes into the input, forget, cell and output gates.
        state: [2 H], the hidden state, then the cell state; overwritten.
    """
    width = len(state) // 2
    for k in range(width):
        taken = sigmoid(np.float64(sums[k])) * tanh(np.float64(sums[2 * width + k]))
        cell = sigmoid(np.float64(sums[width + k])) * np.float64(state[width + k]) + taken
        state[width + k] = np.float32(cell)
        state[k] = np.float32(sigmoid(np.float64(sums[3 * width + k])) * tanh(cell))


@bare_kernel
def lstm(
    header: _Ints, parameters: _Floats, places: _Ints, values: _Floats, count: int, state: _Floats, sums: _Floats
) -> int:
    """The first layer of a recurrent network: one step of its LSTM, from the non-zero inputs to `state`."""
    n_in, width = header[1], header[HEADER_WIDTHS]
    into = sums[: GATES * width]
    biases = (n_in + width) * GATES * width
    others = biases + GATES * width
    for k in range(GATES * width):
        into[k] = parameters[np.uint64(biases + k)] + parameters[np.uint64(others + k)]
    add_rows(parameters, 0, places, values, count, into)
    count = nonzeros(state[:width], places, values)
    add_rows(parameters, n_in * GATES * width, places, values, count, into)
    gates(into, state)
    return int(others + GATES * width)


@bare_kernel
def forward_row(
    header: _Ints,
    parameters: _Floats,
    x: _Floats,
    state: _Floats,
    out: _Floats,
    places: _Ints,
    values: _Floats,
    sums: _Floats,
) -> None:
    """The outputs of one observation.

    Args:
        header: of the network.
        parameters: of the network.
        x: [F], the observation.
        state: [S], what a recurrent network carries along; overwritten.
        out: action values [A], or logits and the state's value [A + 1].
        places: workspace.
        values: workspace.
        sums: workspace.
    """
    kind, n_features, n_actions = header[0], header[1], header[2]
    if kind == EXITS:
        forward_exits(header, parameters, x, out, places, values, sums)
        return
    count = nonzeros(x, places, values)
    if kind == RECURRENT:
        offset = lstm(header, parameters, places, values, count, state, sums)
        count = nonzeros(state[: header[HEADER_WIDTHS]], places, values)
        n_in, layers = header[HEADER_WIDTHS], HEADER_WIDTHS + 1
    else:
        offset, n_in, layers = 0, n_features, HEADER_WIDTHS
    smooth = kind == ACTOR_CRITIC
    n_outputs = n_actions + 1 if kind in (DUELING, RECURRENT) else n_actions
    end = perceptron(header, layers, parameters, offset, n_in, n_outputs, smooth, places, values, count, sums)
    if n_outputs > n_actions:
        join_heads(sums[0], sums[1:], out[:n_actions])  # which may have room for a state's value, too
        return
    for action in range(n_actions):
        out[action] = sums[action]
    if kind in (ACTOR_CRITIC, DUELING_APART):
        count = nonzeros(x, places, values)
        perceptron(header, layers, parameters, end, n_features, 1, smooth, places, values, count, sums)
        if kind == ACTOR_CRITIC:
            out[n_actions] = sums[0]
        else:
            advantages = out[:n_actions]
            join_heads(sums[0], advantages, advantages)


@kernel
def forward(header: _Ints, parameters: _Floats, x: _Floats, state: _Floats, out: _Floats) -> None:
    """The outputs of a batch, a row at a time.

    Args:
        header: [4 + L], see `packing.Layout`.
        parameters: [P], as packed.
        x: [R, F], observations.
        state: [R, S], carried along by recurrent networks (overwritten), else [R, 0].
        out: [R, A] action values, or [R, A + 1] logits and the state's value.
    """
    size = workspace_size(header)
    places, values, sums = np.empty(size, np.int64), np.empty(size, np.float32), np.empty(size, np.float32)
    for row in range(len(x)):
        forward_row(header, parameters, x[row], state[row], out[row], places, values, sums)
