# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""V-trace: what decisions that older weights made are worth under the policy as it is now.

Espeholt et al., "IMPALA: Scalable Distributed Deep-RL with Importance Weighted Actor-Learner Architectures", 2018,
arXiv:1802.01561, equation 1, with both limits of the ratios at 1.

A step there is a train's span from one decision to its next here: its reward is the discounted sum of those on the way,
its discount that of a step to the power of its length, as in `returns`. Limits of 1 make c and rho the same, and with
them (remark 1 of the paper) the sum is

    v_s = (1 - rho_s) V(x_s) + rho_s (r_s + gamma_s v_{s+1})

So the advantage of the paper's policy gradient, rho_s (r_s + gamma_s v_{s+1} - V(x_s)), is v_s - V(x_s): a rule that
takes returns less values as its advantages needs the targets in the place of the returns, and nothing else. If the
policy is the one that acted, the ratios are 1, and the targets are the returns, to the bit.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.records.course import Course

NOBODY = -1  # decides


def clipped_ratios(
    log_probabilities: NDArray[np.float32], log_probabilities_then: NDArray[np.float32]
) -> NDArray[np.float64]:
    """How much as probable actions are now as when they were chosen, at most 1.

    Args:
        log_probabilities: [D], as the policy is now.
        log_probabilities_then: [D], as they were chosen.

    Returns:
        [D], rho.
    """
    changes = log_probabilities.astype(np.float64) - log_probabilities_then
    clipped: NDArray[np.float64] = np.exp(np.minimum(changes, 0.0))
    return clipped


def vtrace_targets(
    course: Course,
    final_values: NDArray[np.float32],
    discount: float,
    values: NDArray[np.float32],
    ratios: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The targets of a whole episode's decisions.

    Args:
        course: of the episode.
        final_values: [N], as of `returns.decision_returns`.
        discount: gamma, a step, less than 1.
        values: [D], scaled, of what was observed, as the critic is now.
        ratios: [D], rho.

    Returns:
        [D], v, scaled by 1 - gamma.
    """
    decisions, following = course.decisions, np.where(course.arrived_at < 0, final_values, np.float32(0))
    places = np.full(course.rewards.shape, NOBODY, np.int64)
    places[decisions.times, decisions.trains] = np.arange(len(decisions))
    targets = np.empty(len(decisions), np.float32)
    trace(np.ascontiguousarray(course.rewards), following, discount, places, values, ratios, targets)
    return targets


@bare_kernel
def trace(
    rewards: NDArray[np.float32],
    following: NDArray[np.float32],
    discount: float,
    places: NDArray[np.int64],
    values: NDArray[np.float32],
    ratios: NDArray[np.float64],
    targets: NDArray[np.float32],
) -> None:
    """Fill `targets` [D], in float64.

    Args:
        rewards: [T, N].
        following: [N], what comes after the last step, scaled.
        discount: gamma.
        places: [T, N], which decision falls there, NOBODY for none.
        values: [D].
        ratios: [D].
        targets: [D], overwritten.
    """
    for train in range(rewards.shape[1]):
        worth = np.float64(following[train])
        for step in range(len(rewards) - 1, -1, -1):
            worth = (1.0 - discount) * rewards[step, train] + discount * worth
            place = places[step, train]
            if place != NOBODY:
                worth = (1.0 - ratios[place]) * np.float64(values[place]) + ratios[place] * worth
                targets[place] = worth
