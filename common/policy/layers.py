# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The layers that the compiled twins of the torch networks are made of, one observation at a time, skipping zeros.

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

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import tanh32
from railctl.common.policy.packing import BLOCK

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_ZERO = np.float32(0)


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
