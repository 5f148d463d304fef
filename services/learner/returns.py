"""Monte Carlo returns of an episode's decisions, for rules that learn a policy.

Source: section 4.3 of the study. A return sums over all environment steps, discounted by each, also over those on which
a train follows the rails and nothing is decided or trained on. What the text leaves open:

- A train that the step limit stopped is worth the critic's value of what it saw last; one that has arrived is not.
- The +1 for everyone on the step on which the last train arrives counts in the returns of all trains, though most have
  arrived before it: the text takes the returns from all of the transitions. (The transitions of value methods end on
  arrival and leave it out.)
- "Normalizing the Returns" here is a fixed scale, 1 - gamma. Rewards of -1 a step then give returns in [-1, 0],
  whatever the episode and the policy: returns in a replay never grow stale, one of another episode can be compared with
  a value, and bootstrapping needs no way back. Returns standardised by episode would call the best decision of a bad
  episode a good one, which is what self-imitation must not do.
"""

import numpy as np
from numpy.typing import NDArray

from common.records import Episode


def monte_carlo_returns(
    rewards: NDArray[np.float32], arrived_at: NDArray[np.int32], final_values: NDArray[np.float32], discount: float
) -> NDArray[np.float32]:
    """What each train gets from each step on, scaled by 1 - gamma.

    Args:
        rewards: [T, N].
        arrived_at: [N], -1 for a train that the step limit stopped.
        final_values: [N], scaled values of what such trains saw last; of others not looked at.
        discount: gamma, a step, less than 1.

    Returns:
        [T, N], summed in float64.
    """
    returns = np.empty(rewards.shape, np.float32)
    following = np.where(arrived_at < 0, final_values.astype(np.float64), 0.0)
    for step in range(len(rewards) - 1, -1, -1):
        following = (1 - discount) * rewards[step] + discount * following
        returns[step] = following
    return returns


def decision_returns(episode: Episode, final_values: NDArray[np.float32], discount: float) -> NDArray[np.float32]:
    """The returns [D] of an episode's decisions; see `monte_carlo_returns`."""
    returns = monte_carlo_returns(episode.rewards, episode.arrived_at, final_values, discount)
    decided: NDArray[np.float32] = returns[episode.times, episode.trains]
    return decided
