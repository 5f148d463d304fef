# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The compiled twins of the torch networks: forward passes of one observation after the other, skipping zeros.

Exactness: a row's sums run over its own non-zero inputs in ascending order, whatever lies beside it in the batch; only
IEEE additions, multiplications and divisions in a fixed order are used (no fastmath, no fused multiply-add, no
function of the system's library), so all x86-64 machines give the same bits. The compiled updates of the learner
(`services.learner.fused`) sum in the same order and give the same bits; torch agrees to rounding.

Speed: about four fifths of a tree observation are exact zeros (see `common.rail.normalise`), and about half of what
ReLU lets through; those rows of the weights are never read. Between layers only the other values are kept, with their
places. Columns are independent sums, so vector instructions change nothing.

The form of the parameters is that of `common.policy.packing`; `offset` says where in them a layer begins, and every
layer returns where it ends.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.policy.arithmetic import sigmoid, tanh, tanh32
from common.policy.packing import ACTOR_CRITIC, BLOCK, GATES, HEADER_WIDTHS, PLAIN, RECURRENT

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_ZERO = np.float32(0)


@bare_kernel
def workspace_size(header: _Ints) -> int:
    """The length of each of the three arrays (places, values, sums) that a forward pass of this network works in."""
    widest = max(header[1], header[2] + BLOCK)
    for width in header[HEADER_WIDTHS:]:
        widest = max(widest, width * (GATES if header[0] == RECURRENT else 1))
    return int(widest) + 1


@bare_kernel
def nonzeros(x: _Floats, places: _Ints, values: _Floats) -> int:
    """Write the places and values of the non-zero entries of x [n] to arrays of more than n; returns their number."""
    count = 0
    for place in range(len(x)):
        places[count] = place
        values[count] = x[place]
        count += x[place] != _ZERO
    return count


@bare_kernel
def rectified(sums: _Floats, places: _Ints, values: _Floats) -> int:
    """ReLU of sums [n]: as `nonzeros`, of what it lets through."""
    count = 0
    for place in range(len(sums)):
        places[count] = place
        values[count] = sums[place]
        count += not (sums[place] <= _ZERO)  # what is not a number shall show
    return count


@bare_kernel
def bounded(sums: _Floats, places: _Ints, values: _Floats) -> int:
    """Tanh of sums [n]: as `nonzeros`, but all entries."""
    for place in range(len(sums)):
        places[place] = place
        values[place] = tanh32(sums[place])
    return len(sums)


@bare_kernel
def add_rows(parameters: _Floats, offset: int, places: _Ints, values: _Floats, count: int, sums: _Floats) -> None:
    """Add `values[i] * weights[places[i]]` to sums [out] for every i below `count`; the weights are [in, out].

    Eight rows at a time, to load and store the sums less often; each still grows by one product after the other.
    Indices are unsigned because compiled code would test signed ones for being negative.
    """
    width, start = np.uint64(len(sums)), np.uint64(offset)
    whole = count - count % 8
    for at in range(0, whole, 8):
        x0, x1, x2, x3 = values[at], values[at + 1], values[at + 2], values[at + 3]
        x4, x5, x6, x7 = values[at + 4], values[at + 5], values[at + 6], values[at + 7]
        row0 = start + np.uint64(places[at]) * width
        row1 = start + np.uint64(places[at + 1]) * width
        row2 = start + np.uint64(places[at + 2]) * width
        row3 = start + np.uint64(places[at + 3]) * width
        row4 = start + np.uint64(places[at + 4]) * width
        row5 = start + np.uint64(places[at + 5]) * width
        row6 = start + np.uint64(places[at + 6]) * width
        row7 = start + np.uint64(places[at + 7]) * width
        for k in range(len(sums)):
            total = sums[k] + x0 * parameters[row0 + np.uint64(k)]
            total = total + x1 * parameters[row1 + np.uint64(k)]
            total = total + x2 * parameters[row2 + np.uint64(k)]
            total = total + x3 * parameters[row3 + np.uint64(k)]
            total = total + x4 * parameters[row4 + np.uint64(k)]
            total = total + x5 * parameters[row5 + np.uint64(k)]
            total = total + x6 * parameters[row6 + np.uint64(k)]
            sums[k] = total + x7 * parameters[row7 + np.uint64(k)]
    for at in range(whole, count):
        row = start + np.uint64(places[at]) * width
        for k in range(len(sums)):
            sums[k] += values[at] * parameters[row + np.uint64(k)]


@bare_kernel
def linear(
    parameters: _Floats, offset: int, n_in: int, places: _Ints, values: _Floats, count: int, sums: _Floats
) -> int:
    """A layer's sums [out] over the non-zero inputs."""
    biases = offset + n_in * len(sums)
    for k in range(len(sums)):
        sums[k] = parameters[np.uint64(biases + k)]
    add_rows(parameters, offset, places, values, count, sums)
    return biases + len(sums)


@bare_kernel
def head(parameters: _Floats, offset: int, n_in: int, places: _Ints, values: _Floats, count: int, sums: _Floats) -> int:
    """As `linear`, for a narrow layer: its sums [a multiple of BLOCK] stay in registers, block by block."""
    width = len(sums)
    biases = offset + n_in * width
    for block in range(0, width, BLOCK):
        b = parameters[biases + block : biases + block + BLOCK]
        s0, s1, s2, s3, s4, s5, s6, s7 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]
        for at in range(count):
            x, row = values[at], np.uint64(offset + places[at] * width + block)
            s0 += x * parameters[row]
            s1 += x * parameters[row + np.uint64(1)]
            s2 += x * parameters[row + np.uint64(2)]
            s3 += x * parameters[row + np.uint64(3)]
            s4 += x * parameters[row + np.uint64(4)]
            s5 += x * parameters[row + np.uint64(5)]
            s6 += x * parameters[row + np.uint64(6)]
            s7 += x * parameters[row + np.uint64(7)]
        sums[block], sums[block + 1], sums[block + 2], sums[block + 3] = s0, s1, s2, s3
        sums[block + 4], sums[block + 5], sums[block + 6], sums[block + 7] = s4, s5, s6, s7
    return biases + width


@bare_kernel
def perceptron(
    header: _Ints,
    first: int,
    parameters: _Floats,
    offset: int,
    n_in: int,
    n_outputs: int,
    smooth: bool,
    places: _Ints,
    values: _Floats,
    count: int,
    sums: _Floats,
) -> int:
    """Hidden layers and a head: from the non-zero inputs to the first `n_outputs` of `sums`.

    Args:
        header: of the network.
        first: where in it the widths of these hidden layers begin.
        parameters: of the network.
        offset: of the first layer.
        n_in: the number of inputs.
        n_outputs: of the head.
        smooth: Tanh between layers instead of ReLU.
        places: of the non-zero inputs; then workspace.
        values: of the non-zero inputs; then workspace.
        count: of the non-zero inputs.
        sums: workspace.
    """
    for layer in range(first, len(header)):
        out = sums[: header[layer]]
        offset = linear(parameters, offset, n_in, places, values, count, out)
        count = bounded(out, places, values) if smooth else rectified(out, places, values)
        n_in = header[layer]
    padded = BLOCK * ((n_outputs + BLOCK - 1) // BLOCK)
    return head(parameters, offset, n_in, places, values, count, sums[:padded])


@bare_kernel
def join_heads(sums: _Floats, out: _Floats) -> None:
    """Action values [A] from V and the advantages [1 + A]: `Q = V + A - mean(A)`."""
    total = _ZERO
    for action in range(len(out)):
        total += sums[1 + action]
    mean = total / np.float32(len(out))
    for action in range(len(out)):
        out[action] = (sums[0] + sums[1 + action]) - mean


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
    count = nonzeros(x, places, values)
    if kind == RECURRENT:
        offset = lstm(header, parameters, places, values, count, state, sums)
        count = nonzeros(state[: header[HEADER_WIDTHS]], places, values)
        n_in, layers = header[HEADER_WIDTHS], HEADER_WIDTHS + 1
    else:
        offset, n_in, layers = 0, n_features, HEADER_WIDTHS
    smooth = kind == ACTOR_CRITIC
    n_outputs = n_actions if kind in (PLAIN, ACTOR_CRITIC) else n_actions + 1
    end = perceptron(header, layers, parameters, offset, n_in, n_outputs, smooth, places, values, count, sums)
    if n_outputs > n_actions:
        join_heads(sums, out)
        return
    for action in range(n_actions):
        out[action] = sums[action]
    if kind == ACTOR_CRITIC:
        count = nonzeros(x, places, values)
        perceptron(header, layers, parameters, end, n_features, 1, True, places, values, count, sums)
        out[n_actions] = sums[0]


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
