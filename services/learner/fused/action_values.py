# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""An update of action values in compiled code: from targets to steps of Adam and of the target network.

What the update is is said in `algorithms.dqn`. The network is a stack (`perceptron`) whose head has the action values,
or a state's value and then the advantages.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.policy.twin import join_heads
from services.learner.fused.packed import GRADIENT, MEAN, SQUARE, TARGET, VALUES
from services.learner.fused.perceptron import descend, gradients, head, mark, norm, outputs, room_for
from services.learner.network.adam import corrections

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
LOSS, MEAN_Q, TD_ERROR, NORM = range(4)  # places in metrics


@bare_kernel
def action_values(sums: _Floats, dueling: bool, q: _Floats) -> None:
    """Fill q [A] from what the head gives."""
    if dueling:
        join_heads(sums, q)
    else:
        for action in range(len(q)):
            q[action] = sums[action]


@bare_kernel
def best(q: _Floats) -> int:
    """The index of the largest of q [A], the lowest of equals; what is not a number counts as the largest."""
    action = 0
    for other in range(1, len(q)):
        if not (q[other] <= q[action]):
            action = other
    return action


@bare_kernel
def spread_gradient(by_q: np.float32, action: int, n_actions: int, dueling: bool, by_sums: _Floats) -> None:
    """The gradient of a head's outputs [W] from that of one action's value."""
    for k in range(len(by_sums)):
        by_sums[k] = 0
    if dueling:
        by_sums[0] = by_q
        for k in range(n_actions):
            by_sums[1 + k] = -by_q / np.float32(n_actions)
        by_sums[1 + action] += by_q
    else:
        by_sums[action] = by_q


@bare_kernel
def follow(target: _Floats, online: _Floats, share: np.float32) -> None:
    """Move `target` [n] a share towards `online`."""
    for i in range(len(target)):
        target[i] += share * (online[i] - target[i])


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
    dueling: bool,
    double: bool,
    action_tm1: _Ints,
    reward_t: _Floats,
    discount_t: _Floats,
    weights: _Floats,
    learning_rate: float,
    tau: np.float32,
    steps: int,
    error_sizes: _Floats,
    metrics: NDArray[np.float64],
) -> bool:
    """An update, unless its loss is not finite; returns whether it was made.

    Args:
        widths: [layers + 1].
        arrays: [5, P], see `packed`; [4, P] if the network is its own target.
        seen: [F].
        starts_tm1: of the observations before the transitions, see `network.sparse`.
        columns_tm1: of the same.
        values_tm1: of the same.
        starts_t: of the observations after the transitions.
        columns_t: of the same.
        values_t: of the same.
        n_actions: A.
        dueling: whether the head is of a value and advantages.
        double: whether the online network picks the action that the target network scores.
        action_tm1: [B], at least one.
        reward_t: [B].
        discount_t: [B].
        weights: [B], of the squared errors.
        learning_rate: of Adam.
        tau: the share that the target network takes of the online one.
        steps: that Adam has made before.
        error_sizes: [B], overwritten.
        metrics: [4], overwritten; the places are named above.
    """
    rows = len(action_tm1)
    room, width = room_for(widths, rows), widths[-1]
    tm1, t = (starts_tm1, columns_tm1, values_tm1), (starts_t, columns_t, values_t)
    sums, by_sums = room.outs[head(widths, rows) :], room.gradients[head(widths, rows) :]
    online, followed = arrays[VALUES], len(arrays) > TARGET
    scoring = arrays[TARGET] if followed else online
    q, picked, targets = np.empty(n_actions, np.float32), np.empty(rows, np.int64), np.empty(rows, np.float32)
    if double:
        outputs(widths, online, t, rows, False, room)
        for row in range(rows):
            action_values(sums[row * width : (row + 1) * width], dueling, q)
            picked[row] = best(q)
    outputs(widths, scoring, t, rows, False, room)
    for row in range(rows):
        action_values(sums[row * width : (row + 1) * width], dueling, q)
        action = picked[row] if double else best(q)
        targets[row] = reward_t[row] + discount_t[row] * q[action]
    mark(starts_tm1, columns_tm1, seen)
    outputs(widths, online, tm1, rows, False, room)
    loss: Any = 0.0
    total: Any = 0.0
    size: Any = 0.0
    for row in range(rows):
        action_values(sums[row * width : (row + 1) * width], dueling, q)
        taken = q[action_tm1[row]]
        error = taken - targets[row]
        error_sizes[row] = abs(error)
        loss += weights[row] * error * error
        total += taken
        size += abs(error)
        by_q = weights[row] * error * np.float32(2.0 / rows)
        spread_gradient(by_q, action_tm1[row], n_actions, dueling, by_sums[row * width : (row + 1) * width])
    metrics[LOSS], metrics[MEAN_Q], metrics[TD_ERROR] = loss / rows, total / rows, size / rows
    if not math.isfinite(loss):
        return False
    gradient = arrays[GRADIENT]
    gradients(widths, online, gradient, tm1, rows, False, room)
    metrics[NORM] = norm(gradient, room.lanes)
    rate, inverse_root = corrections(learning_rate, steps + 1)
    descend(widths, seen, online, gradient, arrays[MEAN], arrays[SQUARE], np.float32(1), rate, inverse_root)
    if followed:
        follow(arrays[TARGET], online, tau)
    return True
