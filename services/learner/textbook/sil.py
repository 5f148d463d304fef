"""The losses of `algorithms.sil` as its paper writes them, in torch."""

from torch import Tensor

from railctl.services.learner.textbook.shapes import check_shapes


def imitation_policy_loss(log_probability_tm1: Tensor, gain: Tensor) -> Tensor:
    """Makes actions more likely that turned out better than expected.

    Equation 2 of Oh et al. 2018, equation 2.36 of the study, without the mean.

    Args:
        log_probability_tm1: [B], of the actions that were taken.
        gain: [B], positive parts of return less value, detached.

    Returns:
        [B].
    """
    check_shapes("B B", log_probability_tm1, gain)
    return -log_probability_tm1 * gain


def imitation_value_loss(value: Tensor, return_t: Tensor) -> Tensor:
    """Half the squared error of values that are too low; values that are too high are left alone.

    Equation 3 of Oh et al. 2018, equation 2.37 of the study, without the mean.

    Args:
        value: [B].
        return_t: [B].

    Returns:
        [B].
    """
    check_shapes("B B", value, return_t)
    return (return_t - value).clamp(min=0).square() / 2
