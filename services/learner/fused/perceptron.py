# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Hidden layers and a head over observations that are mostly zeros: outputs, gradients and a step of Adam.

`widths` is F, then the layers' widths, all multiples of 16 (see `packed`). Parameters lie flat, layer after layer: its
weights [in, out], then its biases [out]. The first layer reads the weights of what is not zero only.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.services.learner.fused.activations import activate, differentiate
from railctl.services.learner.fused.adam import move
from railctl.services.learner.fused.products import forward, input_gradient, weight_gradient
from railctl.services.learner.fused.tile import HEIGHT, WIDTH
from railctl.services.learner.sparse import accumulate, multiply

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_Rows = tuple[_Ints, _Ints, _Floats]  # starts, columns and values, see `services.learner.sparse`
LANES = 64  # sums side by side
_ZERO, _ONE = np.float32(0), np.float32(1)


class Room(NamedTuple):
    """What a batch is worked on in; nothing of it is kept.

    Attributes:
        outs: what comes out of the layers [at least 6 rows, width], one behind the other.
        gradients: of the loss with respect to these.
        panel: see `products`.
        nothing: [the widest layer's width], zeros.
        lanes: [64], see `norm`.
    """

    outs: _Floats
    gradients: _Floats
    panel: _Floats
    nothing: _Floats
    lanes: _Floats


@bare_kernel
def room_rows(rows: int) -> int:
    """How many there is room for."""
    return max(rows, HEIGHT)


@kernel
def room_for(widths: _Ints, rows: int) -> Room:
    """Room for a batch."""
    size = room_rows(rows) * widths[1:].sum()
    deepest = max(room_rows(rows), widths[1:].max())
    return Room(
        np.empty(size, np.float32),
        np.empty(size, np.float32),
        np.empty(deepest * WIDTH, np.float32),
        np.zeros(widths[1:].max(), np.float32),
        np.empty(LANES, np.float32),
    )


@bare_kernel
def length(widths: _Ints) -> int:
    """The number of parameters, those included that fill widths up."""
    total = 0
    for layer in range(1, len(widths)):
        total += (widths[layer - 1] + 1) * widths[layer]
    return total


@bare_kernel
def part_of(widths: _Ints, part: int) -> tuple[int, int]:
    """Where the parameters of one of two stacks, of these widths [2, layers + 1], begin and end."""
    end = length(widths[0])
    return (0, end) if part == 0 else (end, end + length(widths[1]))


@bare_kernel
def head(widths: _Ints, rows: int) -> int:
    """Where in `outs` and in `gradients` the part of the head begins."""
    return int(room_rows(rows) * widths[1:-1].sum())


@bare_kernel
def outputs(widths: _Ints, parameters: _Floats, x: _Rows, rows: int, smooth: bool, room: Room) -> None:
    """Fill `room.outs`; Tanh between layers if `smooth`, else ReLU."""
    (starts, columns, values), n_in, n_out = x, widths[0], widths[1]
    weight, bias = parameters[: n_in * n_out].reshape((n_in, n_out)), parameters[n_in * n_out : (n_in + 1) * n_out]
    out = room.outs[: rows * n_out]
    multiply(starts, columns, values, weight, bias, out.reshape((rows, n_out)))
    activate(out, smooth)
    upper_outputs(widths, parameters[(n_in + 1) * n_out :], rows, smooth, room)


@bare_kernel
def upper_outputs(widths: _Ints, parameters: _Floats, rows: int, smooth: bool, room: Room) -> None:
    """Fill `room.outs` but for what comes out of the first layer; `parameters` are those of the others."""
    end, start = 0, room_rows(rows) * widths[1]
    below = room.outs[:start]
    for layer in range(2, len(widths)):
        n_in, n_out = widths[layer - 1], widths[layer]
        biases = end + n_in * n_out
        weight, bias = parameters[end:biases], parameters[biases : biases + n_out]
        out = room.outs[start : start + room_rows(rows) * n_out]
        forward(below, rows, n_in, weight, bias, n_out, out, room.panel)
        if layer < len(widths) - 1:
            activate(out[: rows * n_out], smooth)
        below, end, start = out, biases + n_out, start + len(out)


@bare_kernel
def gradients(
    widths: _Ints, parameters: _Floats, gradient: _Floats, x: _Rows, rows: int, smooth: bool, room: Room
) -> None:
    """From the head's part of `room.gradients` to those of all parameters, after `outputs` of the same batch."""
    (starts, columns, values), n_in, n_out = x, widths[0], widths[1]
    first = (n_in + 1) * n_out
    upper_gradients(widths, parameters[first:], gradient[first:], rows, smooth, room)
    by_out = room.gradients[: rows * n_out]
    differentiate(room.outs[: rows * n_out], smooth, by_out)
    sum_rows(by_out, rows, gradient[n_in * n_out : first])
    by_weight = gradient[: n_in * n_out].reshape((n_in, n_out))
    accumulate(starts, columns, values, by_out.reshape((rows, n_out)), by_weight)


@bare_kernel
def upper_gradients(widths: _Ints, parameters: _Floats, gradient: _Floats, rows: int, smooth: bool, room: Room) -> None:
    """From the head's part of `room.gradients` to that of the first layer's outputs.

    And to those of `parameters`, which are the other layers'.
    """
    end, stop = len(parameters), len(room.outs)
    for layer in range(len(widths) - 1, 1, -1):
        n_in, n_out = widths[layer - 1], widths[layer]
        biases = end - n_out
        begin, start = biases - n_in * n_out, stop - room_rows(rows) * n_out
        by_out = room.gradients[start:stop]
        if layer < len(widths) - 1:
            differentiate(room.outs[start : start + rows * n_out], smooth, by_out[: rows * n_out])
        sum_rows(by_out, rows, gradient[biases:end])
        before, by_weight, nothing = start - room_rows(rows) * n_in, gradient[begin:biases], room.nothing
        weight_gradient(room.outs[before:start], rows, n_in, by_out, n_out, nothing, 0, by_weight, room.panel)
        by_in = room.gradients[before:start]
        input_gradient(by_out, rows, n_out, parameters[begin:biases], n_in, by_in, room.panel, nothing)
        end, stop = begin, start


@bare_kernel
def sum_rows(matrix: _Floats, rows: int, out: _Floats) -> None:
    """Out [n] is the sum of a matrix [rows, n]."""
    width = len(out)
    for k in range(width):
        out[k] = _ZERO
    for row in range(rows):
        part = matrix[row * width : (row + 1) * width]
        for k in range(width):
            out[k] += part[k]


@bare_kernel
def norm(gradient: _Floats, lanes: _Floats) -> float:
    """L2, of [n]: sums of squares side by side, then one after the other in float64; `lanes` [64] is overwritten."""
    for k in range(LANES):
        lanes[k] = _ZERO
    whole = len(gradient) // LANES * LANES
    for first in range(0, whole, LANES):
        part = gradient[first : first + LANES]
        for k in range(LANES):
            lanes[k] += part[k] * part[k]
    total: Any = 0.0
    for k in range(LANES):
        total += np.float64(lanes[k])
    for i in range(whole, len(gradient)):
        total += np.float64(gradient[i]) * np.float64(gradient[i])
    return math.sqrt(total)


@bare_kernel
def mark(starts: _Ints, columns: _Ints, seen: NDArray[np.bool_]) -> None:
    """Note in `seen` [F] which inputs a batch has."""
    for at in range(starts[-1]):
        seen[columns[at]] = True


@bare_kernel
def descend(
    width: int,
    seen: NDArray[np.bool_],
    values: _Floats,
    gradient: _Floats,
    mean: _Floats,
    square: _Floats,
    scale: np.float32,
    rate: np.float32,
    inverse_root: np.float32,
) -> None:
    """A step of Adam, but for weights of inputs that never were `seen` [F]: it would leave them as they are.

    `width` is how many weights an input has; those of the inputs come first.
    """
    for column in range(len(seen)):
        if seen[column]:
            a, b = column * width, (column + 1) * width
            move(values[a:b], gradient[a:b], mean[a:b], square[a:b], scale, rate, inverse_root)
    a = len(seen) * width
    move(values[a:], gradient[a:], mean[a:], square[a:], scale, rate, inverse_root)
