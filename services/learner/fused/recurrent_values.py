# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""An update of action values over sequences in compiled code: as `action_values`, with an LSTM as first layer.

What the update is is said in `algorithms.drqn`.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.services.learner.fused.action_values import err, pick, score, step
from railctl.services.learner.fused.packed import GRADIENT, VALUES
from railctl.services.learner.fused.perceptron import Room, head, mark, room_for, upper_gradients, upper_outputs
from railctl.services.learner.fused.recurrent import Line, Memory, line_up, memory_for, run, run_back

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_Rows = tuple[_Ints, _Ints, _Floats]


@bare_kernel
def look(
    widths: _Ints, n_first: int, units: int, parameters: _Floats, x: _Rows, line: Line, memory: Memory, room: Room
) -> None:
    """What the network makes of sequences; its first `n_first` parameters are the LSTM's."""
    rows = len(line.order)
    run(parameters[:n_first], x, line, units, memory, room.outs[: rows * widths[1]])
    upper_outputs(widths, parameters[n_first:], rows, False, room)


@kernel
def update(
    widths: _Ints,
    n_gates: int,
    units: int,
    arrays: _Floats,
    seen: NDArray[np.bool_],
    starts_tm1: _Ints,
    columns_tm1: _Ints,
    values_tm1: _Floats,
    starts_t: _Ints,
    columns_t: _Ints,
    values_t: _Floats,
    n_actions: int,
    picking: int,
    scoring: int,
    action_tm1: _Ints,
    reward_t: _Floats,
    discount_t: _Floats,
    allowed_t: _Ints,
    weights: _Floats,
    learning_rate: float,
    tau: np.float32,
    steps: int,
    error_sizes: _Floats,
    metrics: NDArray[np.float64],
) -> bool:
    """An update, unless its loss is not finite; returns whether it was made.

    Args as of `action_values.update`, the head being dueling, and of `recurrent`: `widths[1]` is W, `n_gates` G, and
    `units` H. Rows are those of sequences [L, B].
    """
    rows = len(action_tm1)
    sequence = (len(starts_tm1) - 1) // rows
    n_first = (widths[0] + widths[1] + 2) * n_gates
    room, memory = room_for(widths, rows), memory_for(sequence, rows, widths[1], n_gates)
    tm1, t = (starts_tm1, columns_tm1, values_tm1), (starts_t, columns_t, values_t)
    line_tm1, line_t = line_up(starts_tm1, sequence), line_up(starts_t, sequence)
    begin, end = head(widths, rows), head(widths, rows) + rows * widths[-1]
    sums, by_sums = room.outs[begin:end], room.gradients[begin:end]
    online, gradient = arrays[VALUES], arrays[GRADIENT]
    q, picked, targets = np.empty(n_actions, np.float32), np.empty(rows, np.int64), np.empty(rows, np.float32)
    double = picking != scoring
    if double:
        look(widths, n_first, units, arrays[picking], t, line_t, memory, room)
        pick(sums, True, q, allowed_t, picked)
    look(widths, n_first, units, arrays[scoring], t, line_t, memory, room)
    score(sums, True, q, double, picked, reward_t, discount_t, allowed_t, targets)
    mark(starts_tm1, columns_tm1, seen)
    look(widths, n_first, units, online, tm1, line_tm1, memory, room)
    if not err(sums, True, q, action_tm1, targets, weights, by_sums, error_sizes, metrics):
        return False
    upper_gradients(widths, online[n_first:], gradient[n_first:], rows, False, room)
    by_hidden = room.gradients[: rows * widths[1]]
    run_back(online[:n_first], gradient[:n_first], tm1, line_tm1, units, memory, by_hidden)
    step(n_gates, seen, arrays, learning_rate, tau, steps, room.lanes, metrics)
    return True
