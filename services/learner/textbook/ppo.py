"""The losses of `algorithms.ppo` as its papers write them, in torch."""

import torch
from torch import Tensor

from railctl.services.learner.fused.policy_losses import FLOOR
from railctl.services.learner.textbook.shapes import check_shapes


def log_probability(logits: Tensor, action: Tensor) -> Tensor:
    """The logarithm of the probability that softmax gives to the actions taken.

    Args:
        logits: [B, A].
        action: [B].

    Returns:
        [B].
    """
    check_shapes("BA B", logits, action)
    return torch.log_softmax(logits, -1).gather(-1, action.unsqueeze(-1)).squeeze(-1)


def standardised(advantage: Tensor) -> Tensor:
    """Advantages less their mean, over their standard deviation and a little, `FLOOR`.

    Args:
        advantage: [B].

    Returns:
        [B]; zero if there is but one.
    """
    check_shapes("B", advantage)
    return (advantage - advantage.mean()) / (advantage.std(correction=0) + FLOOR)


def clipped_surrogate(ratio: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """The objective of the actor, to be maximised: no gain from moving a probability by more than a share `clip`.

    Equation 7 of Schulman et al. 2017, equation 2.27 of the study, without the mean.

    Args:
        ratio: [B], the action's probability now over that when it was chosen.
        advantage: [B], detached.
        clip: epsilon.

    Returns:
        [B].
    """
    check_shapes("B B", ratio, advantage)
    return torch.minimum(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage)


def clipped_value_loss(value: Tensor, value_old: Tensor, return_t: Tensor, clip: float) -> Tensor:
    """The squared error of the critic, or that of its value held within `clip` of the old one, whichever is larger.

    Equation 4.3 of the study, without the mean.

    Args:
        value: [B].
        value_old: [B], when the action was chosen.
        return_t: [B].
        clip: epsilon.

    Returns:
        [B].
    """
    check_shapes("B B B", value, value_old, return_t)
    held = value_old + (value - value_old).clamp(-clip, clip)
    return torch.maximum((value - return_t).square(), (held - return_t).square())


def divergence(logits: Tensor, logits_start: Tensor) -> Tensor:
    """KL(policy || start), in nats.

    Args:
        logits: [B, A], of the policy; those of actions that are not allowed are the least there are.
        logits_start: [B, A], of the other one, likewise.

    Returns:
        [B].
    """
    check_shapes("BA BA", logits, logits_start)
    log_p, log_q = torch.log_softmax(logits, -1), torch.log_softmax(logits_start, -1)
    return (log_p.exp() * (log_p - log_q)).sum(-1)


def entropy(logits: Tensor) -> Tensor:
    """The entropy of softmax, in nats.

    Args:
        logits: [B, A].

    Returns:
        [B].
    """
    check_shapes("BA", logits)
    log_probabilities = torch.log_softmax(logits, -1)
    return -(log_probabilities.exp() * log_probabilities).sum(-1)
