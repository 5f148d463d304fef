# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""An update of action values in compiled code: from targets to steps of Adam and of the target network.

What the update is is said in `algorithms.dqn`. The network is a stack (`perceptron`) whose head has the action values,
or a state's value and then the advantages.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.common.policy.twin import join_heads
from railctl.services.learner.fused.adam import corrections
from railctl.services.learner.fused.packed import GRADIENT, MEAN, SQUARE, TARGET, VALUES, follow
from railctl.services.learner.fused.perceptron import descend, gradients, head, mark, norm, outputs, room_for

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
LOSS, MEAN_Q, TD_ERROR, NORM = range(4)  # places in metrics


@bare_kernel
def action_values(sums: _Floats, dueling: bool, q: _Floats) -> None:
    """Fill q [A] from what the head gives."""
    if dueling:
        join_heads(sums[0], sums[1:], q)
    else:
        for action in range(len(q)):
            q[action] = sums[action]


@bare_kernel
def best(q: _Floats, allowed: int) -> int:
    """The allowed action with the largest of q [A], the lowest of equals; what is not a number counts as the largest.

    One is allowed at least; a bit says so for each.
    """
    action = -1
    for other in range(len(q)):
        if allowed >> other & 1 and (action < 0 or not (q[other] <= q[action])):
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
def pick(sums: _Floats, dueling: bool, q: _Floats, allowed_t: _Ints, picked: _Ints) -> None:
    """Fill `picked` [B] with the best allowed actions by a head's outputs [B, W], flat; `q` [A] is overwritten."""
    width = len(sums) // len(picked)
    for row in range(len(picked)):
        action_values(sums[row * width : (row + 1) * width], dueling, q)
        picked[row] = best(q, allowed_t[row])


@bare_kernel
def score(
    sums: _Floats, dueling: bool, q: _Floats, double: bool, picked: _Ints, reward_t: _Floats, discount_t: _Floats,
    allowed_t: _Ints, targets: _Floats,
) -> None:  # fmt: skip
    """Fill `targets` [B] from a head's outputs [B, W], flat: of the actions `picked` if `double`, else of the best.

    The best are the best of those allowed [B].
    """
    width = len(sums) // len(targets)
    for row in range(len(targets)):
        action_values(sums[row * width : (row + 1) * width], dueling, q)
        action = picked[row] if double else best(q, allowed_t[row])
        targets[row] = reward_t[row] + discount_t[row] * q[action]


@bare_kernel
def err(
    sums: _Floats, dueling: bool, q: _Floats, action_tm1: _Ints, targets: _Floats, weights: _Floats, by_sums: _Floats,
    error_sizes: _Floats, metrics: NDArray[np.float64],
) -> bool:  # fmt: skip
    """From a head's outputs [B, W], flat, to the loss's gradient by them; returns whether the loss is finite."""
    rows = len(action_tm1)
    width = len(sums) // rows
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
        spread_gradient(by_q, action_tm1[row], len(q), dueling, by_sums[row * width : (row + 1) * width])
    metrics[LOSS], metrics[MEAN_Q], metrics[TD_ERROR] = loss / rows, total / rows, size / rows
    return math.isfinite(loss)


@bare_kernel
def step(
    width: int, seen: NDArray[np.bool_], arrays: _Floats, learning_rate: float, tau: np.float32, steps: int,
    lanes: _Floats, metrics: NDArray[np.float64],
) -> None:  # fmt: skip
    """A step of Adam along the gradients, and one of the target network if it has a share; `width` as of `descend`."""
    gradient = arrays[GRADIENT]
    metrics[NORM] = norm(gradient, lanes)
    rate, inverse_root = corrections(learning_rate, steps + 1)
    descend(width, seen, arrays[VALUES], gradient, arrays[MEAN], arrays[SQUARE], np.float32(1), rate, inverse_root)
    if tau > 0:
        follow(arrays[TARGET], arrays[VALUES], tau)


@kernel
def update(
    widths: _Ints,
    dueling: bool,
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

    Args:
        widths: [layers + 1].
        dueling: whether the head is of a value and advantages.
        arrays: [5, P], see `packed`; [4, P] if the network is its own target.
        seen: [F].
        starts_tm1: of the observations before the transitions, see `services.learner.sparse`.
        columns_tm1: of the same.
        values_tm1: of the same.
        starts_t: of the observations after the transitions.
        columns_t: of the same.
        values_t: of the same.
        n_actions: A.
        picking: the row of `arrays` whose network picks the actions of targets.
        scoring: that of the network that scores them.
        action_tm1: [B], at least one.
        reward_t: [B].
        discount_t: [B].
        allowed_t: [B], the actions that targets may be of, a bit each.
        weights: [B], of the squared errors.
        learning_rate: of Adam.
        tau: the share that the target network takes of the online one; 0: it stays as it is.
        steps: that Adam has made before.
        error_sizes: [B], overwritten.
        metrics: [4], overwritten; the places are named above.
    """
    rows = len(action_tm1)
    room = room_for(widths, rows)
    tm1, t = (starts_tm1, columns_tm1, values_tm1), (starts_t, columns_t, values_t)
    begin, end = head(widths, rows), head(widths, rows) + rows * widths[-1]
    sums, by_sums = room.outs[begin:end], room.gradients[begin:end]
    online = arrays[VALUES]
    q, picked, targets = np.empty(n_actions, np.float32), np.empty(rows, np.int64), np.empty(rows, np.float32)
    double = picking != scoring
    if double:
        outputs(widths, arrays[picking], t, rows, False, room)
        pick(sums, dueling, q, allowed_t, picked)
    outputs(widths, arrays[scoring], t, rows, False, room)
    score(sums, dueling, q, double, picked, reward_t, discount_t, allowed_t, targets)
    mark(starts_tm1, columns_tm1, seen)
    outputs(widths, online, tm1, rows, False, room)
    if not err(sums, dueling, q, action_tm1, targets, weights, by_sums, error_sizes, metrics):
        return False
    gradients(widths, online, arrays[GRADIENT], tm1, rows, False, room)
    step(widths[1], seen, arrays, learning_rate, tau, steps, room.lanes, metrics)
    return True
