# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""An update of action values in compiled code: as `action_values`, of advantages and a value that share nothing.

Both are stacks (`perceptron`); their arrays lie one behind the other (`packed`), those of the advantages first.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.services.learner.fused.action_values import NORM, err, pick, score
from railctl.services.learner.fused.adam import corrections
from railctl.services.learner.fused.packed import GRADIENT, MEAN, SQUARE, TARGET, VALUES, follow
from railctl.services.learner.fused.perceptron import (
    Room,
    descend,
    gradients,
    head,
    mark,
    norm,
    outputs,
    part_of,
    room_for,
)

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_Rows = tuple[_Ints, _Ints, _Floats]


@bare_kernel
def look(widths: _Ints, parameters: _Floats, x: _Rows, rooms: tuple[Room, Room], sums: _Floats) -> None:
    """What both stacks make of observations: `sums` [B, 1 + A], as one head would give them."""
    rows = len(sums)
    for part in range(2):
        begin, end = part_of(widths, part)
        outputs(widths[part], parameters[begin:end], x, rows, False, rooms[part])
    advantages, values = rooms[0].outs[head(widths[0], rows) :], rooms[1].outs[head(widths[1], rows) :]
    for row in range(rows):
        sums[row, 0] = values[row * widths[1, -1]]
        for action in range(sums.shape[1] - 1):
            sums[row, 1 + action] = advantages[row * widths[0, -1] + action]


@bare_kernel
def spread(widths: _Ints, by_sums: _Floats, rooms: tuple[Room, Room]) -> None:
    """The gradients of both heads' outputs from those of `sums` [B, 1 + A]."""
    rows = len(by_sums)
    by_advantages = rooms[0].gradients[head(widths[0], rows) :]
    by_values = rooms[1].gradients[head(widths[1], rows) :]
    by_advantages[:] = 0
    by_values[:] = 0
    for row in range(rows):
        by_values[row * widths[1, -1]] = by_sums[row, 0]
        for action in range(by_sums.shape[1] - 1):
            by_advantages[row * widths[0, -1] + action] = by_sums[row, 1 + action]


@bare_kernel
def step(
    widths: _Ints, seen: NDArray[np.bool_], arrays: _Floats, learning_rate: float, tau: np.float32, steps: int,
    lanes: _Floats, metrics: NDArray[np.float64],
) -> None:  # fmt: skip
    """As `action_values.step`, of both stacks."""
    metrics[NORM] = norm(arrays[GRADIENT], lanes)
    rate, inverse_root = corrections(learning_rate, steps + 1)
    for part in range(2):
        begin, end = part_of(widths, part)
        values, gradient = arrays[VALUES, begin:end], arrays[GRADIENT, begin:end]
        mean, square = arrays[MEAN, begin:end], arrays[SQUARE, begin:end]
        descend(widths[part, 1], seen, values, gradient, mean, square, np.float32(1), rate, inverse_root)
    if tau > 0:
        follow(arrays[TARGET], arrays[VALUES], tau)


@kernel
def update(
    widths: _Ints,
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

    Args as of `action_values.update`, but `widths` [2, layers + 1], of advantages and value.
    """
    rows = len(action_tm1)
    tm1, t = (starts_tm1, columns_tm1, values_tm1), (starts_t, columns_t, values_t)
    rooms = room_for(widths[0], rows), room_for(widths[1], rows)
    sums, by_sums = np.empty((rows, 1 + n_actions), np.float32), np.empty((rows, 1 + n_actions), np.float32)
    q, picked, targets = np.empty(n_actions, np.float32), np.empty(rows, np.int64), np.empty(rows, np.float32)
    double = picking != scoring
    if double:
        look(widths, arrays[picking], t, rooms, sums)
        pick(sums.reshape(-1), True, q, allowed_t, picked)
    look(widths, arrays[scoring], t, rooms, sums)
    score(sums.reshape(-1), True, q, double, picked, reward_t, discount_t, allowed_t, targets)
    mark(starts_tm1, columns_tm1, seen)
    look(widths, arrays[VALUES], tm1, rooms, sums)
    if not err(sums.reshape(-1), True, q, action_tm1, targets, weights, by_sums.reshape(-1), error_sizes, metrics):
        return False
    spread(widths, by_sums, rooms)
    for part in range(2):
        begin, end = part_of(widths, part)
        values, gradient = arrays[VALUES, begin:end], arrays[GRADIENT, begin:end]
        gradients(widths[part], values, gradient, tm1, rows, False, rooms[part])
    step(widths, seen, arrays, learning_rate, tau, steps, rooms[0].lanes, metrics)
    return True
