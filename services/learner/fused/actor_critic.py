# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Updates of an actor-critic in compiled code: all of a batch's epochs in one call.

What the updates are is said in `algorithms.ppo`, `sil` and `imitate`. Actor and critic are two stacks that share
nothing (`perceptron`); their arrays lie one behind the other (`packed`), the actor's first.
"""

import math

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel, kernel
from railctl.services.learner.fused.adam import corrections
from railctl.services.learner.fused.packed import GRADIENT, MEAN, SQUARE, VALUES
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
from railctl.services.learner.fused.policy_losses import anchor_loss, cloning_loss, imitation_loss, ppo_loss
from railctl.services.learner.fused.tile import WIDTH

_Floats = NDArray[np.float32]
_Doubles = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Rows = tuple[_Ints, _Ints, _Floats]
NORM, LOSS = -2, -1  # places in a row of metrics


@bare_kernel
def look(widths: _Ints, arrays: _Floats, x: _Rows, rows: int, rooms: tuple[Room, Room]) -> None:
    """What actor and critic make of observations."""
    for part in range(2):
        begin, end = part_of(widths, part)
        outputs(widths[part], arrays[VALUES, begin:end], x, rows, True, rooms[part])


@bare_kernel
def learn(
    widths: _Ints,
    arrays: _Floats,
    seen: NDArray[np.bool_],
    x: _Rows,
    rows: int,
    rooms: tuple[Room, Room],
    limit: float,
    learning_rate: float,
    steps: int,
) -> float:
    """A step of Adam, number `steps`, from the gradients of the heads' outputs; actor and critic are clipped each.

    Returns:
        The L2 norm of all gradients, before they are clipped.
    """
    rate, inverse_root = corrections(learning_rate, steps)
    squared = 0.0
    for part in range(2):
        begin, end = part_of(widths, part)
        values, gradient = arrays[VALUES, begin:end], arrays[GRADIENT, begin:end]
        gradients(widths[part], values, gradient, x, rows, True, rooms[part])
        size = norm(gradient, rooms[part].lanes)
        squared += size * size
        scale = np.float32(limit / size) if size > limit else np.float32(1)
        mean, square = arrays[MEAN, begin:end], arrays[SQUARE, begin:end]
        descend(widths[part, 1], seen, values, gradient, mean, square, scale, rate, inverse_root)
    return math.sqrt(squared)


@kernel
def ppo(
    widths: _Ints,
    arrays: _Floats,
    seen: NDArray[np.bool_],
    start: _Floats,
    starts: _Ints,
    columns: _Ints,
    values: _Floats,
    n_actions: int,
    action_tm1: _Ints,
    allowed_tm1: _Ints,
    return_t: _Floats,
    log_probability_tm1: _Floats,
    value_tm1: _Floats,
    standardises: bool,
    clip: float,
    value_weight: float,
    entropy_weight: float,
    anchor_weight: float,
    limit: float,
    learning_rate: float,
    steps: int,
    metrics: _Doubles,
) -> int:
    """As many updates on a batch as `metrics` has rows, or fewer: one whose loss is not finite is not made.

    Args:
        widths: [2, layers + 1], of actor and critic.
        arrays: [4, P], see `packed`.
        seen: [F].
        start: [P], the parameters that the network began with.
        starts: of the batch's observations, see `services.learner.sparse`.
        columns: of the same.
        values: of the same.
        n_actions: A.
        action_tm1: [B], at least one.
        allowed_tm1: [B].
        return_t: [B].
        log_probability_tm1: [B].
        value_tm1: [B].
        standardises: whether advantages are standardised over the batch.
        clip: epsilon.
        value_weight: of the critic's loss.
        entropy_weight: of the bonus.
        anchor_weight: of the divergence from the policy that the network began with; 0: nobody looks at it.
        limit: of the gradient of actor and critic each.
        learning_rate: of Adam.
        steps: that Adam has made before.
        metrics: [epochs, 8]: as `ppo_loss` names them, then the norm of all gradients, then the loss.

    Returns:
        How many were made.
    """
    rows = len(action_tm1)
    x, rooms = (starts, columns, values), (room_for(widths[0], rows), room_for(widths[1], rows))
    mark(starts, columns, seen)
    actor, critic = head(widths[0], rows), head(widths[1], rows)
    logits, by_logits = rooms[0].outs[actor:], rooms[0].gradients[actor:]
    worths, by_worths = rooms[1].outs[critic:], rooms[1].gradients[critic:]
    is_anchored = anchor_weight > 0
    anchor = np.empty(len(logits) if is_anchored else 0, np.float32)
    probabilities = np.empty(widths[0, -1], np.float32)
    if is_anchored:
        begin, end = part_of(widths, 0)
        outputs(widths[0], start[begin:end], x, rows, True, rooms[0])
        anchor[:] = logits
    for epoch in range(len(metrics)):
        look(widths, arrays, x, rows, rooms)
        loss = ppo_loss(
            logits, worths, by_logits, by_worths, n_actions, action_tm1, allowed_tm1, return_t, log_probability_tm1,
            value_tm1, standardises, clip, value_weight, entropy_weight, metrics[epoch],
        )  # fmt: skip
        if is_anchored:
            loss += anchor_loss(logits, by_logits, anchor, probabilities, n_actions, allowed_tm1, anchor_weight)
        metrics[epoch, LOSS] = loss
        if not math.isfinite(loss):
            return epoch
        metrics[epoch, NORM] = learn(widths, arrays, seen, x, rows, rooms, limit, learning_rate, steps + epoch + 1)
    return len(metrics)


@kernel
def imitate(
    widths: _Ints,
    arrays: _Floats,
    seen: NDArray[np.bool_],
    starts: _Ints,
    columns: _Ints,
    values: _Floats,
    n_actions: int,
    action_tm1: _Ints,
    allowed_tm1: _Ints,
    least_return_t: _Floats,
    value_weight: float,
    limit: float,
    learning_rate: float,
    steps: int,
    gains: _Floats,
    metrics: _Doubles,
) -> bool:
    """An update of self-imitation, unless its loss is not finite; returns whether it was made.

    Args as of `ppo`; `gains` [B] are overwritten, and `metrics` [6]: as `imitation_loss`
    names them, then the norm, then the loss.
    """
    rows = len(action_tm1)
    x, rooms = (starts, columns, values), (room_for(widths[0], rows), room_for(widths[1], rows))
    mark(starts, columns, seen)
    look(widths, arrays, x, rows, rooms)
    actor, critic = head(widths[0], rows), head(widths[1], rows)
    loss = imitation_loss(
        rooms[0].outs[actor:], rooms[1].outs[critic:], rooms[0].gradients[actor:], rooms[1].gradients[critic:],
        n_actions, action_tm1, allowed_tm1, least_return_t, value_weight, gains, metrics,
    )  # fmt: skip
    metrics[LOSS] = loss
    if not math.isfinite(loss):
        return False
    metrics[NORM] = learn(widths, arrays, seen, x, rows, rooms, limit, learning_rate, steps + 1)
    return True


@kernel
def clone(
    widths: _Ints,
    arrays: _Floats,
    seen: NDArray[np.bool_],
    starts: _Ints,
    columns: _Ints,
    values: _Floats,
    n_actions: int,
    action_tm1: _Ints,
    allowed_tm1: _Ints,
    return_t: _Floats,
    value_weight: float,
    limit: float,
    learning_rate: float,
    steps: int,
    metrics: _Doubles,
) -> bool:
    """An update of imitation of a teacher, unless its loss is not finite; returns whether it was made.

    Args as of `ppo`; `metrics` [5] are overwritten: as `cloning_loss` names them, then the norm, then the loss.
    """
    rows = len(action_tm1)
    x, rooms = (starts, columns, values), (room_for(widths[0], rows), room_for(widths[1], rows))
    mark(starts, columns, seen)
    look(widths, arrays, x, rows, rooms)
    actor, critic = head(widths[0], rows), head(widths[1], rows)
    loss = cloning_loss(
        rooms[0].outs[actor:], rooms[1].outs[critic:], rooms[0].gradients[actor:], rooms[1].gradients[critic:],
        n_actions, action_tm1, allowed_tm1, return_t, value_weight, metrics,
    )  # fmt: skip
    metrics[LOSS] = loss
    if not math.isfinite(loss):
        return False
    metrics[NORM] = learn(widths, arrays, seen, x, rows, rooms, limit, learning_rate, steps + 1)
    return True


@kernel
def evaluate(widths: _Ints, arrays: _Floats, starts: _Ints, columns: _Ints, values: _Floats, out: _Floats) -> None:
    """Fill `out` [B] with the critic's values of observations."""
    rows = len(out)
    room = room_for(widths[1], rows)
    begin, end = part_of(widths, 1)
    outputs(widths[1], arrays[VALUES, begin:end], (starts, columns, values), rows, True, room)
    worths = room.outs[head(widths[1], rows) :]
    for row in range(rows):
        out[row] = worths[row * WIDTH]
