# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The compiled twin of the network of exits (`common.policy.exits`); of its sums see `common.policy.layers`.

What is the same for all exits, the train's and the other trains' shares of the encoders, is summed once.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import Real, exp, tanh32
from railctl.common.policy.exit_layers import N_STAYS, NO_EXIT
from railctl.common.policy.layers import add_rows, bounded, head, linear, nonzeros
from railctl.common.policy.packing import BLOCK, HEADER_WIDTHS
from railctl.common.rail.observations.traffic_shape import (
    EXITS_END,
    N_EXIT,
    N_EXITS,
    N_MEETING,
    N_OTHER,
    N_ROW,
    N_TRAIN,
)
from railctl.common.rail.world import DO_NOTHING, MOVE_LEFT, STOP_MOVING

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_ZERO = np.float32(0)
MINUS_ONE: Final = np.float32(-1)


@bare_kernel
def widest(header: _Ints) -> int:
    """The most inputs or outputs, with padding, of a layer."""
    most = N_TRAIN + 2 * header[len(header) - 1] + BLOCK
    for width in header[HEADER_WIDTHS:]:
        most = max(most, 2 * width)
    return int(max(most, N_TRAIN + N_EXIT, N_OTHER + N_MEETING)) + 1


@bare_kernel
def exits_room(header: _Ints) -> int:
    """The length of each of the three arrays that a forward pass works in."""
    rows, first = (header[1] - EXITS_END) // N_ROW, header[HEADER_WIDTHS]
    return int(widest(header) + (4 + 2 * rows) * first + rows + N_EXITS * header[len(header) - 1])


@bare_kernel
def forward_exits(
    header: _Ints, parameters: _Floats, x: _Floats, out: _Floats, places: _Ints, values: _Floats, sums: _Floats
) -> None:
    """The logits and the value [6] of one observation; the arguments are those of `twin.forward_row`."""
    rows, first, last = (header[1] - EXITS_END) // N_ROW, header[HEADER_WIDTHS], header[len(header) - 1]
    sums, kept = sums[: widest(header)], sums[widest(header) :]
    shares, kept = kept[: (1 + rows) * first], kept[(1 + rows) * first :]
    codes, kept = kept[: rows * first], kept[rows * first :]
    joined, kept = kept[: 2 * first], kept[2 * first :]
    query, kept = kept[:first], kept[first:]
    scores, ends = kept[:rows], kept[rows:]
    present = share_all(parameters, x, rows, first, places, values, shares)
    exits = 0
    for way in range(N_EXITS):
        of = x[N_TRAIN + way * N_EXIT : N_TRAIN + (way + 1) * N_EXIT]
        if of[0] == _ZERO:
            out[MOVE_LEFT + way] = np.float32(NO_EXIT)
            continue
        offset = encode_exit(parameters, of, shares[:first], places, values, joined[:first])
        encode_rows(parameters, offset, x, way, present, first, shares[first:], places, values, codes)
        offset += (N_OTHER + N_MEETING + 1) * first
        count = nonzeros(joined[:first], places, values)
        offset = linear(parameters, offset, first, places, values, count, query)
        attend(query, codes, present, scores, joined[first:])
        count = nonzeros(joined, places, values)
        move_logit(header, parameters, offset, places, values, count, sums)
        out[MOVE_LEFT + way] = sums[0]
        for k in range(last):
            ends[exits * last + k] = values[k]
        exits += 1
    describe_all(x[:N_TRAIN], ends, exits, last, sums)
    inputs = 2 * last + N_TRAIN
    for place in range(inputs):
        values[place] = sums[place]
        places[place] = place
    offset = linear(parameters, after_moves(header), inputs, places, values, inputs, sums[:last])
    count = bounded(sums[:last], places, values)
    head(parameters, offset, last, places, values, count, sums[:BLOCK])
    out[DO_NOTHING], out[STOP_MOVING], out[MOVE_LEFT + N_EXITS + 1] = sums[0], sums[1], sums[N_STAYS]


@bare_kernel
def share_all(
    parameters: _Floats, x: _Floats, rows: int, first: int, places: _Ints, values: _Floats, shares: _Floats
) -> int:
    """Sum what is the same behind all exits: of the train, then of each row that is there [rows, first]; how many."""
    biases = (N_TRAIN + N_EXIT) * first
    for k in range(first):
        shares[k] = parameters[biases + k]
    count = nonzeros(x[:N_TRAIN], places, values)
    add_rows(parameters, 0, places, values, count, shares[:first])
    begin = biases + first
    biases = begin + (N_OTHER + N_MEETING) * first
    present = 0
    while present < rows and x[EXITS_END + present * N_ROW] != _ZERO:
        share = shares[(1 + present) * first : (2 + present) * first]
        for k in range(first):
            share[k] = parameters[biases + k]
        of = x[EXITS_END + present * N_ROW : EXITS_END + present * N_ROW + N_OTHER]
        count = nonzeros(of, places, values)
        add_rows(parameters, begin, places, values, count, share)
        present += 1
    return present


@bare_kernel
def encode_exit(parameters: _Floats, of: _Floats, share: _Floats, places: _Ints, values: _Floats, code: _Floats) -> int:
    """The code of an exit of these numbers [16], beside the train's share; returns where the next layer begins."""
    for k in range(len(code)):
        code[k] = share[k]
    count = nonzeros(of, places, values)
    add_rows(parameters, N_TRAIN * len(code), places, values, count, code)
    for k in range(len(code)):
        code[k] = tanh32(code[k])
    return (N_TRAIN + N_EXIT + 1) * len(code)


@bare_kernel
def encode_rows(
    parameters: _Floats,
    offset: int,
    x: _Floats,
    way: int,
    present: int,
    width: int,
    shares: _Floats,
    places: _Ints,
    values: _Floats,
    codes: _Floats,
) -> None:
    """The codes of the other trains behind an exit, beside their shares; the layer begins at `offset`."""
    for row in range(present):
        code = codes[row * width : (row + 1) * width]
        for k in range(width):
            code[k] = shares[row * width + k]
        begin = EXITS_END + row * N_ROW + N_OTHER + way * N_MEETING
        count = nonzeros(x[begin : begin + N_MEETING], places, values)
        add_rows(parameters, offset + N_OTHER * width, places, values, count, code)
        for k in range(width):
            code[k] = tanh32(code[k])


@bare_kernel
def attend(query: _Floats, codes: _Floats, present: int, scores: _Floats, context: _Floats) -> None:
    """The mean of codes [present, h], weighted by softmax of their scaled products with a query [h]."""
    width = len(query)
    context[:] = 0
    if present == 0:
        return
    scale = 1.0 / math.sqrt(width)
    top: Real = -np.inf
    for row in range(present):
        product = _ZERO
        for k in range(width):
            product += query[k] * codes[row * width + k]
        scores[row] = np.float32(np.float64(product) * scale)
        top = max(top, float(scores[row]))
    total: Real = 0.0
    for row in range(present):
        total += exp(np.float64(scores[row]) - top)
    for row in range(present):
        weight = np.float32(exp(np.float64(scores[row]) - top) / total)
        for k in range(width):
            context[k] += weight * codes[row * width + k]


@bare_kernel
def move_logit(
    header: _Ints, parameters: _Floats, offset: int, places: _Ints, values: _Floats, count: int, sums: _Floats
) -> None:
    """From an exit's code and context to its logit in `sums`, and its last hidden layer in `values`."""
    n_in = 2 * header[HEADER_WIDTHS]
    for layer in range(min(HEADER_WIDTHS + 1, len(header) - 1), len(header)):
        out = sums[: header[layer]]
        offset = linear(parameters, offset, n_in, places, values, count, out)
        count = bounded(out, places, values)
        n_in = header[layer]
    head(parameters, offset, n_in, places, values, count, sums[:BLOCK])


@bare_kernel
def after_moves(header: _Ints) -> int:
    """Where the layers begin that come after those of the exits."""
    first = header[HEADER_WIDTHS]
    offset = (N_TRAIN + N_EXIT + 1 + N_OTHER + N_MEETING + 1 + first + 1) * first
    n_in = 2 * first
    for layer in range(min(HEADER_WIDTHS + 1, len(header) - 1), len(header)):
        offset += (n_in + 1) * header[layer]
        n_in = header[layer]
    return int(offset + (n_in + 1) * BLOCK)


@bare_kernel
def describe_all(train: _Floats, ends: _Floats, exits: int, width: int, pooled: _Floats) -> None:
    """Means and maxima of the last hidden layers [exits, width], zeros if there is no exit, then the train."""
    for k in range(width):
        total, most = _ZERO, MINUS_ONE
        for number in range(exits):
            total += ends[number * width + k]
            most = max(most, ends[number * width + k])
        pooled[k] = total / np.float32(max(1, exits))
        pooled[width + k] = most if exits > 0 else _ZERO
    for place in range(N_TRAIN):
        pooled[2 * width + place] = train[place]
