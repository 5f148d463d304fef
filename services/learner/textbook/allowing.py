"""Scores of actions that were not allowed, out of the way of maxima and of softmax."""

import torch
from torch import Tensor

from railctl.services.learner.textbook.shapes import check_shapes


def allowed_only(scores: Tensor, allowed: Tensor) -> Tensor:
    """Action values or logits of which those of other actions are the least that there is: finite, for gradients.

    Args:
        scores: [B, A].
        allowed: [B], a bit for each action, one of them at least.

    Returns:
        [B, A].
    """
    check_shapes("BA B", scores, allowed)
    forbidden = (allowed.unsqueeze(-1) >> torch.arange(scores.shape[-1]) & 1) == 0
    return scores.masked_fill(forbidden, torch.finfo(scores.dtype).min)
