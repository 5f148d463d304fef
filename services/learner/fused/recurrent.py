# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""An LSTM along sequences of observations that are mostly zeros, and back through time.

Hochreiter & Schmidhuber 1997, with the forget gate of Gers et al. 2000; gates and parameters as in `torch.nn.LSTM`. A
sequence may begin later than others of its batch: rows of zeros before its first observation leave its state at zero,
just as a train acts that has seen nothing yet. Sequences are worked on in the order in which they begin, so that those
that have begun are always the first ones, and nothing is computed for others.

Parameters lie flat: weights of the inputs [F, G] and of the hidden state [W, G], biases of both [G]. The gates of H
units, input, forget, cell and output, lie side by side; G is their number 4 H, and W is H, each filled up to a multiple
of 16.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.policy.arithmetic import tanh32
from railctl.services.learner.fused.activations import sigmoid32
from railctl.services.learner.fused.perceptron import room_rows
from railctl.services.learner.fused.products import multiply_panels, pack_panels, pack_panels_turned, weight_gradient
from railctl.services.learner.fused.tile import WIDTH

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_Rows = tuple[_Ints, _Ints, _Floats]  # starts, columns and values, see `services.learner.sparse`
_ZERO, _ONE = np.float32(0), np.float32(1)


class Line(NamedTuple):
    """The order of a batch's sequences.

    Attributes:
        order: [B], which sequence comes at a place: those that begin early first.
        begun: [L + 1], how many have begun before a step, and at last all that ever do.
    """

    order: _Ints
    begun: _Ints


class Memory(NamedTuple):
    """What a batch is worked on in. R is B, or 6 if there are fewer.

    Attributes:
        gates: [L, R, G], after their functions; going back, the gradients of their sums.
        cells: [L, R, W].
        tanhs: [L, R, W], of the cells.
        hiddens: [L, R, W].
        sums: [R, G], without what comes from the hidden state.
        by_hidden: [R, W].
        by_cell: [R, W].
        bias: [G].
        panels: [G W], weights of the hidden state, panel by panel.
        spare: [W G], for sums of gradients.
        panel: see `products`.
        nothing: [G], zeros.
    """

    gates: _Floats
    cells: _Floats
    tanhs: _Floats
    hiddens: _Floats
    sums: _Floats
    by_hidden: _Floats
    by_cell: _Floats
    bias: _Floats
    panels: _Floats
    spare: _Floats
    panel: _Floats
    nothing: _Floats


@kernel
def memory_for(steps: int, batch: int, filled: int, n_gates: int) -> Memory:
    """Room for sequences [L, B]; `filled` is W, `n_gates` G."""
    rows = room_rows(batch)
    return Memory(
        np.empty(steps * rows * n_gates, np.float32),
        np.empty(steps * rows * filled, np.float32),
        np.empty(steps * rows * filled, np.float32),
        np.empty(steps * rows * filled, np.float32),
        np.empty(rows * n_gates, np.float32),
        np.empty(rows * filled, np.float32),
        np.empty(rows * filled, np.float32),
        np.empty(n_gates, np.float32),
        np.empty(n_gates * filled, np.float32),
        np.empty(n_gates * filled, np.float32),
        np.empty(rows * WIDTH, np.float32),
        np.zeros(n_gates, np.float32),
    )


@kernel
def line_up(starts: _Ints, steps: int) -> Line:
    """Sequences [L, B] in the order in which they begin, which they do with their first row that is not all zeros."""
    batch = (len(starts) - 1) // steps
    line, waits = Line(np.empty(batch, np.int64), np.zeros(steps + 1, np.int64)), np.ones(batch, np.bool_)
    count = 0
    for step in range(steps):
        for item in range(batch):
            row = step * batch + item
            if waits[item] and starts[row + 1] > starts[row]:
                line.order[count], waits[item] = item, False
                count += 1
        line.begun[step + 1] = count
    for item in range(batch):
        if waits[item]:
            line.order[count] = item
            count += 1
    return line


@bare_kernel
def add_row(x: _Rows, row: int, weight: _Floats, bias: _Floats, sums: _Floats) -> None:
    """Let sums [G] be the bias [G] and a row of x times weight [F, G], flat."""
    starts, columns, values = x
    width, first, last = len(sums), starts[row], starts[row + 1]
    whole = first + (last - first) // 4 * 4
    for k in range(width):
        sums[k] = bias[k]
    for at in range(first, whole, 4):  # four rows of the weights at a time, to load and store the sums less often
        x0, x1, x2, x3 = values[at], values[at + 1], values[at + 2], values[at + 3]
        w0, w1 = weight[columns[at] * width :], weight[columns[at + 1] * width :]
        w2, w3 = weight[columns[at + 2] * width :], weight[columns[at + 3] * width :]
        for k in range(width):
            sums[k] = sums[k] + x0 * w0[k] + x1 * w1[k] + x2 * w2[k] + x3 * w3[k]
    for at in range(whole, last):
        x0, w0 = values[at], weight[columns[at] * width :]
        for k in range(width):
            sums[k] += x0 * w0[k]


@bare_kernel
def remember(gates: _Floats, before: _Floats, cells: _Floats, tanhs: _Floats, hiddens: _Floats, units: int) -> None:
    """A step of a sequence: from the sums into its gates [G] and the cells before [W] to the other three [W]."""
    taken, kept = gates[:units], gates[units : 2 * units]
    fresh, shown = gates[2 * units : 3 * units], gates[3 * units : 4 * units]
    for k in range(2 * units):
        gates[k] = sigmoid32(gates[k])
    for k in range(units):
        fresh[k] = tanh32(fresh[k])
    for k in range(units):
        shown[k] = sigmoid32(shown[k])
    for k in range(units):
        cells[k] = kept[k] * before[k] + taken[k] * fresh[k]
    for k in range(units):
        tanhs[k] = tanh32(cells[k])
    for k in range(units):
        hiddens[k] = shown[k] * tanhs[k]
    for k in range(units, len(hiddens)):
        hiddens[k] = _ZERO


@bare_kernel
def trace_back(
    gates: _Floats, before: _Floats, tanhs: _Floats, by_hidden: _Floats, by_cell: _Floats, units: int
) -> None:
    """A step of a sequence back in time.

    Args:
        gates: [G], overwritten with the gradient of the sums into them.
        before: [W], the cells before.
        tanhs: [W], of the cells after.
        by_hidden: [W], the gradient of the hidden state after.
        by_cell: [W], that of the cells after, without what goes through the hidden state; overwritten with that of the
            cells before.
        units: H.
    """
    taken, kept = gates[:units], gates[units : 2 * units]
    fresh, shown = gates[2 * units : 3 * units], gates[3 * units : 4 * units]
    for k in range(units):
        by_cell[k] += by_hidden[k] * shown[k] * (_ONE - tanhs[k] * tanhs[k])
    for k in range(units):
        shown[k] = by_hidden[k] * tanhs[k] * shown[k] * (_ONE - shown[k])
    for k in range(units):
        of_taken = by_cell[k] * fresh[k] * taken[k] * (_ONE - taken[k])
        fresh[k] = by_cell[k] * taken[k] * (_ONE - fresh[k] * fresh[k])
        taken[k] = of_taken
    for k in range(units):
        of_kept = by_cell[k] * before[k] * kept[k] * (_ONE - kept[k])
        by_cell[k] *= kept[k]
        kept[k] = of_kept


@bare_kernel
def parts_of(parameters: _Floats, filled: int, n_gates: int) -> tuple[_Floats, _Floats, _Floats]:
    """Weights of the inputs, weights of the hidden state and biases."""
    hidden = len(parameters) - (filled + 2) * n_gates
    biases = hidden + filled * n_gates
    return parameters[:hidden], parameters[hidden:biases], parameters[biases:]


@bare_kernel
def run(parameters: _Floats, x: _Rows, line: Line, units: int, memory: Memory, out: _Floats) -> None:
    """Fill `out` [B, W] with the hidden states of sequences [L, B] after their last step, zero at first."""
    batch, filled, n_gates = len(line.order), len(out) // len(line.order), len(memory.bias)
    size = room_rows(batch) * filled
    inputs, weight, biases = parts_of(parameters, filled, n_gates)
    for k in range(n_gates):
        memory.bias[k] = biases[k] + biases[n_gates + k]
    pack_panels(weight, filled, n_gates, memory.panels)
    for step in range(len(line.begun) - 1):
        count, before, here = line.begun[step + 1], line.begun[step], step * size
        gates = memory.gates[step * room_rows(batch) * n_gates :]
        sums = memory.sums if before else gates
        for place in range(count):
            row = step * batch + line.order[place]
            add_row(x, row, inputs, memory.bias, sums[place * n_gates : (place + 1) * n_gates])
        if before:
            hiddens = memory.hiddens[here - size : here]
            multiply_panels(hiddens, count, filled, memory.panels, sums, n_gates, n_gates, gates)
        for place in range(count):
            a, b = here + place * filled, here + (place + 1) * filled
            old = memory.cells[a - size : b - size] if place < before else memory.nothing
            own = gates[place * n_gates : (place + 1) * n_gates]
            remember(own, old, memory.cells[a:b], memory.tanhs[a:b], memory.hiddens[a:b], units)
        memory.hiddens[here + count * filled : here + batch * filled] = _ZERO
    last = memory.hiddens[len(memory.hiddens) - size :]
    for place in range(batch):
        copy_row(last, place, out, line.order[place], filled)


@bare_kernel
def run_back(
    parameters: _Floats, gradient: _Floats, x: _Rows, line: Line, units: int, memory: Memory, by_out: _Floats
) -> None:
    """From the gradient of the hidden states after the last step [B, W], after `run`, to those of `parameters`."""
    batch, filled, n_gates = len(line.order), len(by_out) // len(line.order), len(memory.bias)
    size = room_rows(batch) * filled
    by_inputs, by_weight, by_biases = parts_of(gradient, filled, n_gates)
    gradient[:] = _ZERO
    pack_panels_turned(parts_of(parameters, filled, n_gates)[1], filled, n_gates, memory.panels)
    memory.by_cell[:] = _ZERO
    for place in range(batch):
        copy_row(by_out, line.order[place], memory.by_hidden, place, filled)
    left = 0  # products that are still to be added up to the gradient of the hidden state's weights
    for before in line.begun[1:-1]:
        left += before > 0
    sums, width = memory.nothing, 0
    for step in range(len(line.begun) - 2, -1, -1):
        count, before, here = line.begun[step + 1], line.begun[step], step * size
        gates = memory.gates[step * room_rows(batch) * n_gates :]
        for place in range(count):
            a, b = here + place * filled, here + (place + 1) * filled
            old = memory.cells[a - size : b - size] if place < before else memory.nothing
            by_gates, by_cell = gates[place * n_gates : (place + 1) * n_gates], memory.by_cell[a - here : b - here]
            trace_back(by_gates, old, memory.tanhs[a:b], memory.by_hidden[a - here : b - here], by_cell, units)
            spread(x, step * batch + line.order[place], by_gates, by_inputs, by_biases)
        if before:
            left -= 1
            hiddens, total = memory.hiddens[here - size : here], memory.spare if left % 2 else by_weight
            weight_gradient(hiddens, before, filled, gates, n_gates, sums, width, total, memory.panel)
            sums, width = total, n_gates
            multiply_panels(gates, before, n_gates, memory.panels, memory.nothing, 0, filled, memory.by_hidden)
    copy_row(by_biases, 0, by_biases, 1, n_gates)


@bare_kernel
def copy_row(matrix: _Floats, row: int, other: _Floats, other_row: int, width: int) -> None:
    """Copy a row of a matrix [., width] into one of another."""
    for k in range(width):
        other[other_row * width + k] = matrix[row * width + k]


@bare_kernel
def spread(x: _Rows, row: int, by_gates: _Floats, by_inputs: _Floats, by_bias: _Floats) -> None:
    """Add what a step of a sequence says to the gradients of the inputs' weights [F, G] and of the bias [G]."""
    starts, columns, values = x
    width = len(by_gates)
    for at in range(starts[row], starts[row + 1]):
        value, weights = values[at], by_inputs[columns[at] * width : (columns[at] + 1) * width]
        for k in range(width):
            weights[k] += value * by_gates[k]
    for k in range(width):
        by_bias[k] += by_gates[k]
