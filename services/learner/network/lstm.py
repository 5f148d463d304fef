"""An LSTM along sequences of observations, with backpropagation through time.

Hochreiter & Schmidhuber 1997, with the forget gate of Gers et al. 2000; gates and parameters as in `torch.nn.LSTM`. A
sequence may begin later than others of its batch: rows of zeros before its first observation leave its state at zero,
just as a train acts that has seen nothing yet.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.kernel import bare_kernel
from services.learner.network.layers import Memory, tanh_
from services.learner.network.parameters import Parameters
from services.learner.network.sparse import SparseRows, accumulate, multiply

_Floats = NDArray[np.float32]
GATES = 4  # input, forget, cell, output


class Lstm:
    """From sequences [L, B, F] to the hidden state after their last observation."""

    def __init__(self, parameters: Parameters, name: str) -> None:
        """Its parameters are `name`.weight_ih_l0 and the other three that `torch.nn.LSTM` has."""
        names = [f"{name}.{part}_l0" for part in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")]
        self._in, self._hidden, self._bias_in, self._bias_hidden = (parameters.value(part) for part in names)
        self._gradients = [parameters.gradient(part) for part in names]
        width = len(self._hidden)
        self._gates, self._gate_gradients = Memory(GATES * width), Memory(GATES * width)
        self._hiddens, self._cells, self._tanh_cells = Memory(width), Memory(width), Memory(width)
        self._hidden_gradient, self._cell_gradient = Memory(width), Memory(width)
        self._begun = np.zeros((0, 0), np.float32)
        self._x: SparseRows

    def forward(self, x: SparseRows) -> Tensor:
        """[L, B, F] to [B, H], the state being zero at first."""
        steps, batch, _ = x.shape
        self._x, self._begun = x, begun(x)
        gates, width = self._gates.of(steps, batch), len(self._hidden)
        hiddens, cells, tanhs = (memory.of(steps, batch) for memory in (self._hiddens, self._cells, self._tanh_cells))
        bias = (self._bias_in + self._bias_hidden).numpy()
        multiply(x.starts, x.columns, x.values, self._in.numpy(), bias, gates.view(steps * batch, -1).numpy())
        before = torch.zeros(batch, width)
        for t in range(steps):
            if t > 0:
                gates[t].addmm_(hiddens[t - 1], self._hidden)
            gates[t, :, : 2 * width].sigmoid_()
            tanh_(gates[t, :, 2 * width : 3 * width])
            gates[t, :, 3 * width :].sigmoid_()
            remember(gates[t].numpy(), before.numpy(), self._begun[t], cells[t].numpy())
            before = cells[t]
            tanh_(tanhs[t].copy_(before))
            torch.mul(gates[t, :, 3 * width :], tanhs[t], out=hiddens[t])
        return hiddens[-1]

    def backward(self, gradient: Tensor) -> None:
        """Of [B, H]."""
        steps, batch, _ = self._x.shape
        gates, cells, tanhs = (memory.of(steps, batch) for memory in (self._gates, self._cells, self._tanh_cells))
        by_gate = self._gate_gradients.of(steps, batch)
        by_cell = self._cell_gradient.of(batch).zero_()
        nothing = torch.zeros_like(by_cell)
        for t in range(steps - 1, -1, -1):
            before = cells[t - 1] if t > 0 else nothing
            back(
                gates[t].numpy(), before.numpy(), tanhs[t].numpy(), self._begun[t],
                gradient.numpy(), by_cell.numpy(), by_gate[t].numpy(),
            )  # fmt: skip
            if t > 0:
                gradient = torch.mm(by_gate[t], self._hidden.t(), out=self._hidden_gradient.of(batch))
        self._finish(by_gate.view(steps * batch, -1), batch)

    def _finish(self, by_gate: Tensor, batch: int) -> None:
        """The gradients of the parameters, from those of the sums into the gates [L * B, 4 H]."""
        of_in, of_hidden, of_bias_in, of_bias_hidden = self._gradients
        accumulate(self._x.starts, self._x.columns, self._x.values, by_gate.numpy(), of_in.numpy())
        hiddens = self._hiddens.of(*self._x.shape[:2]).view(len(by_gate), -1)
        torch.mm(hiddens[: len(by_gate) - batch].t(), by_gate[batch:], out=of_hidden)
        torch.sum(by_gate, 0, out=of_bias_in)
        of_bias_hidden.copy_(of_bias_in)


def begun(x: SparseRows) -> _Floats:
    """[L, B]: 1 from the first row on that is not all zeros, 0 before."""
    steps, batch, _ = x.shape
    something = (np.diff(x.starts) > 0).reshape(steps, batch)
    return np.maximum.accumulate(something, axis=0).astype(np.float32)


@bare_kernel
def remember(gates: _Floats, before: _Floats, begun: _Floats, cells: _Floats) -> None:
    """The new cell state [B, H] from the gates [B, 4 H] and the one before; zero where nothing has begun."""
    width = cells.shape[1]
    for row in range(len(cells)):
        gate, old, new = gates[row], before[row], cells[row]
        taken, kept, fresh = gate[:width], gate[width : 2 * width], gate[2 * width : 3 * width]
        for k in range(width):
            new[k] = begun[row] * (kept[k] * old[k] + taken[k] * fresh[k])


@bare_kernel
def back(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    gates: _Floats,
    before: _Floats,
    tanh_cells: _Floats,
    begun: _Floats,
    by_hidden: _Floats,
    by_cell: _Floats,
    by_gate: _Floats,
) -> None:
    """One step back in time.

    Args:
        gates: [B, 4 H], after their sigmoids and tanh.
        before: [B, H], the cell state before.
        tanh_cells: [B, H], Tanh of the one after.
        begun: [B].
        by_hidden: [B, H], the gradient of the hidden state after.
        by_cell: [B, H], that of the cell state after, without what goes through the hidden state; overwritten with that
            of the cell state before.
        by_gate: [B, 4 H], overwritten with that of the sums into the gates.
    """
    width, one = tanh_cells.shape[1], np.float32(1)
    for row in range(len(gates)):
        for k in range(width):
            i, f = gates[row, k], gates[row, width + k]
            g, o = gates[row, 2 * width + k], gates[row, 3 * width + k]
            tanh, of_hidden = tanh_cells[row, k], by_hidden[row, k]
            of_cell = begun[row] * (by_cell[row, k] + of_hidden * o * (one - tanh * tanh))
            by_gate[row, k] = of_cell * g * i * (one - i)
            by_gate[row, width + k] = of_cell * before[row, k] * f * (one - f)
            by_gate[row, 2 * width + k] = of_cell * i * (one - g * g)
            by_gate[row, 3 * width + k] = of_hidden * tanh * o * (one - o)
            by_cell[row, k] = of_cell * f
