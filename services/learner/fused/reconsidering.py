# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""What an actor-critic says now of decisions that were made with other weights."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.services.learner.fused.actor_critic import look
from railctl.services.learner.fused.perceptron import head, room_for
from railctl.services.learner.fused.policy_losses import softmax
from railctl.services.learner.fused.tile import WIDTH

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]


@kernel
def reconsider(
    widths: _Ints,
    arrays: _Floats,
    starts: _Ints,
    columns: _Ints,
    values: _Floats,
    n_actions: int,
    action_tm1: _Ints,
    allowed_tm1: _Ints,
    log_probabilities: _Floats,
    worths: _Floats,
) -> None:
    """Fill `log_probabilities` [B], of the actions, and `worths` [B], the critic's; the other args as of `ppo`."""
    rows, width = len(action_tm1), widths[0, -1]
    rooms = room_for(widths[0], rows), room_for(widths[1], rows)
    look(widths, arrays, (starts, columns, values), rows, rooms)
    logits, critics = rooms[0].outs[head(widths[0], rows) :], rooms[1].outs[head(widths[1], rows) :]
    probabilities = np.empty(width, np.float32)
    for row in range(rows):
        z = logits[row * width : (row + 1) * width]
        log_total = softmax(z, n_actions, allowed_tm1[row], probabilities)
        log_probabilities[row] = np.float64(z[action_tm1[row]]) - log_total
        worths[row] = critics[row * WIDTH]
