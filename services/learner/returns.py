"""Monte Carlo returns of an episode's decisions, for rules that learn a policy.

Source: section 4.3 of the study. A return sums over all environment steps, discounted by each, also over those on which
a train follows the rails and nothing is decided or trained on. What the text leaves open:

- A train that the step limit stopped is worth the critic's value of what it saw last; one that has arrived is not.
- The +1 for everyone on the step on which the last train arrives counts in the returns of all trains, though most have
  arrived before it: the text takes the returns from all of the transitions. (The transitions of value methods end on
  arrival and leave it out.)
- "Normalizing the Returns" here is a fixed scale, 1 - gamma. Rewards of -1 a step then give returns in [-1, 0],
  whatever the episode and the policy: returns in a replay never grow stale, one of another episode can be compared with
  a value, and bootstrapping needs no way back. Returns standardised by episode call the best decision of a bad episode
  a good one, which is what self-imitation must not do. With `ppo.returns: standardised` they are what is learned from;
  what follows the last step is then the critic's word as it is, a standardised return for one of steps.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.records.course import Course

SMALL: Final = 1e-8


def decision_returns(course: Course, final_values: NDArray[np.float32], discount: float) -> NDArray[np.float32]:
    """What the trains get from each decision of an episode on.

    Args:
        course: of a whole episode.
        final_values: [N], scaled values of what trains saw last that the step limit stopped; of others not looked at.
        discount: gamma, a step, less than 1.

    Returns:
        [D], scaled by 1 - gamma.
    """
    following = np.where(course.arrived_at < 0, final_values, np.float32(0))
    returns = np.empty(course.rewards.shape, np.float32)
    accumulate(np.ascontiguousarray(course.rewards), following, discount, returns)
    decided: NDArray[np.float32] = returns[course.decisions.times, course.decisions.trains]
    return decided


def standardised(returns: NDArray[np.float32], by: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns [D] less the mean of `by` [D], over its standard deviation and a little."""
    standard = np.empty_like(returns)
    standardise(returns, by, standard)
    return standard


@bare_kernel
def standardise(returns: NDArray[np.float32], by: NDArray[np.float32], standard: NDArray[np.float32]) -> None:
    """Fill `standard` [D]; see `standardised`."""
    count = max(1, len(by))
    total: Any = 0.0
    for value in by:
        total += np.float64(value)
    mean = total / count
    squares: Any = 0.0
    for value in by:
        squares += (np.float64(value) - mean) * (np.float64(value) - mean)
    scale = math.sqrt(squares / count) + SMALL
    for place in range(len(returns)):
        standard[place] = (np.float64(returns[place]) - mean) / scale


@bare_kernel
def accumulate(
    rewards: NDArray[np.float32], following: NDArray[np.float32], discount: float, returns: NDArray[np.float32]
) -> None:
    """Fill `returns` [T, N] with discounted sums of rewards [T, N], scaled by 1 - gamma, in float64.

    Args:
        rewards: [T, N].
        following: [N], what comes after the last step, scaled.
        discount: gamma.
        returns: [T, N], overwritten.
    """
    for train in range(rewards.shape[1]):
        sum_from = np.float64(following[train])
        for step in range(len(rewards) - 1, -1, -1):
            sum_from = (1.0 - discount) * rewards[step, train] + discount * sum_from
            returns[step, train] = sum_from
