# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The losses of `algorithms.ppo`, `sil` and `imitate`, and their gradients by logits and values, row after row.

In float64, with functions of our own (`common.policy.arithmetic`). Logits and their gradients are [B, W] of a padded
head, flat; values [B, 16], the first column. What fills a head up has no gradient, and what was
not allowed neither: its probability is zero.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import Real, exp, log
from railctl.services.learner.fused.tile import WIDTH

_Floats = NDArray[np.float32]
FLOOR = 1e-3  # of scaled advantages: a tenth of a step; lesser differences are not blown up to 1
POLICY_LOSS, VALUE_LOSS, ENTROPY, VALUE_ERROR, CLIP_SHARE, KL = range(6)
CROSS_ENTROPY, CRITIC_LOSS, AGREEMENT = range(3)
SIL_POLICY_LOSS, SIL_VALUE_LOSS, SIL_GAIN, SIL_POSITIVE_SHARE = range(4)


@bare_kernel
def softmax(logits: _Floats, n_actions: int, allowed: int, probabilities: _Floats) -> float:
    """Fill probabilities [W] from logits [W]; what is behind the actions, or not allowed, gets zeros.

    Returns:
        The logarithm of the sum of all exponentials.
    """
    top: Real = -np.inf
    for action in range(n_actions):
        if allowed >> action & 1:
            top = max(top, np.float64(logits[action]))
    total: Real = 0.0
    for action in range(n_actions):
        probabilities[action] = 0
        if allowed >> action & 1:
            power = exp(np.float64(logits[action]) - top)
            probabilities[action] = power
            total += power
    for action in range(n_actions):
        probabilities[action] = np.float64(probabilities[action]) / total
    for action in range(n_actions, len(probabilities)):
        probabilities[action] = 0
    return float(top + log(total))


@bare_kernel
def spread(return_t: _Floats, values: _Floats) -> tuple[float, float]:
    """The mean of returns [B] less values [B, 16], and their standard deviation and a little."""
    count = len(return_t)
    mean: Real = 0.0
    for row in range(count):
        mean += np.float64(return_t[row]) - np.float64(values[row * WIDTH])
    mean /= count
    variance: Real = 0.0
    for row in range(count):
        difference = np.float64(return_t[row]) - np.float64(values[row * WIDTH]) - mean
        variance += difference * difference
    return float(mean), math.sqrt(variance / count) + FLOOR


@bare_kernel
def ppo_loss(
    logits: _Floats,
    values: _Floats,
    by_logits: _Floats,
    by_values: _Floats,
    n_actions: int,
    action_tm1: NDArray[np.int64],
    allowed_tm1: NDArray[np.int64],
    return_t: _Floats,
    log_probability_tm1: _Floats,
    value_tm1: _Floats,
    standardises: bool,
    clip: float,
    value_weight: float,
    entropy_weight: float,
    metrics: NDArray[np.float64],
) -> float:
    """`-surrogate + value_weight * value loss - entropy_weight * entropy`, means over the batch.

    Args:
        logits: [B, W], flat.
        values: [B, 16], flat.
        by_logits: overwritten with the loss's gradient with respect to `logits`.
        by_values: the same for `values`.
        n_actions: A.
        action_tm1: [B].
        allowed_tm1: [B], the actions that there were to choose from, a bit each.
        return_t: [B].
        log_probability_tm1: [B], of the action when it was chosen.
        value_tm1: [B], when the action was chosen.
        standardises: whether advantages are standardised over the batch.
        clip: epsilon.
        value_weight: of the critic's loss.
        entropy_weight: of the bonus.
        metrics: [at least 6], overwritten; the places are named above.
    """
    count, width = len(action_tm1), len(logits) // len(values) * WIDTH
    share = 1.0 / count
    mean, scale = spread(return_t, values) if standardises else (0.0, 1.0)
    policy_loss: Any = 0.0
    value_loss: Any = 0.0
    bonus: Any = 0.0
    value_error: Any = 0.0
    outside: Any = 0.0
    divergence: Any = 0.0
    for row in range(count):
        z, by_z = logits[row * width : (row + 1) * width], by_logits[row * width : (row + 1) * width]
        by_value = by_values[row * WIDTH : (row + 1) * WIDTH]
        log_total = softmax(z, n_actions, allowed_tm1[row], by_z)
        entropy: Real = 0.0
        for action in range(n_actions):
            entropy -= np.float64(by_z[action]) * (np.float64(z[action]) - log_total)
        chosen = action_tm1[row]
        log_ratio = np.float64(z[chosen]) - log_total - np.float64(log_probability_tm1[row])
        ratio: Any = exp(log_ratio)
        value, target = np.float64(values[row * WIDTH]), np.float64(return_t[row])
        advantage = (target - value - mean) / scale
        free: Any = ratio * advantage
        held: Any = min(max(ratio, 1 - clip), 1 + clip) * advantage
        policy_loss -= min(free, held)
        by_log = -share * free if free <= held else 0.0
        for action in range(n_actions):
            probability = np.float64(by_z[action])
            by_entropy = probability * (np.float64(z[action]) - log_total + entropy)
            by_z[action] = by_log * ((action == chosen) - probability) + entropy_weight * share * by_entropy
        change: Any = value - np.float64(value_tm1[row])
        kept = np.float64(value_tm1[row]) + min(max(change, -clip), clip)
        own: Any = (value - target) * (value - target)
        bounded: Any = (kept - target) * (kept - target)
        value_loss += max(own, bounded)
        for k in range(WIDTH):
            by_value[k] = 0
        if abs(change) <= clip or own > bounded:
            by_value[0] = value_weight * share * 2.0 * (value - target)
        bonus += entropy
        value_error += abs(target - value)
        outside += int(abs(ratio - 1) > clip)
        divergence += ratio - 1 - log_ratio
    metrics[POLICY_LOSS], metrics[VALUE_LOSS], metrics[ENTROPY] = policy_loss * share, value_loss * share, bonus * share
    metrics[VALUE_ERROR], metrics[CLIP_SHARE], metrics[KL] = value_error * share, outside * share, divergence * share
    return float(share * (policy_loss + value_weight * value_loss - entropy_weight * bonus))


@bare_kernel
def anchor_loss(
    logits: _Floats,
    by_logits: _Floats,
    anchor: _Floats,
    probabilities: _Floats,
    n_actions: int,
    allowed_tm1: NDArray[np.int64],
    weight: float,
) -> float:
    """`weight * KL(policy || another)`, the mean over the batch.

    Args:
        logits: [B, W], flat.
        by_logits: [B, W], flat, to which its gradient with respect to `logits` is added.
        anchor: [B, W], flat, the logits of the other policy.
        probabilities: [W], to work on.
        n_actions: A.
        allowed_tm1: [B], the actions that there were to choose from, a bit each.
        weight: of the divergence.
    """
    count, width = len(allowed_tm1), len(probabilities)
    share = weight / count
    divergence: Any = 0.0
    for row in range(count):
        z, start = logits[row * width : (row + 1) * width], anchor[row * width : (row + 1) * width]
        by_z, bits = by_logits[row * width : (row + 1) * width], allowed_tm1[row]
        log_start = softmax(start, n_actions, bits, probabilities)
        log_total = softmax(z, n_actions, bits, probabilities)
        apart: Real = 0.0
        for action in range(n_actions):
            if bits >> action & 1:
                ratio = (np.float64(z[action]) - log_total) - (np.float64(start[action]) - log_start)
                apart += np.float64(probabilities[action]) * ratio
        for action in range(n_actions):
            if bits >> action & 1:
                ratio = (np.float64(z[action]) - log_total) - (np.float64(start[action]) - log_start)
                more = share * np.float64(probabilities[action]) * (ratio - apart)
                by_z[action] = np.float64(by_z[action]) + more
        divergence += apart
    return float(share * divergence)


@bare_kernel
def imitation_loss(
    logits: _Floats,
    values: _Floats,
    by_logits: _Floats,
    by_values: _Floats,
    n_actions: int,
    action_tm1: NDArray[np.int64],
    allowed_tm1: NDArray[np.int64],
    least_return_t: _Floats,
    value_weight: float,
    gains: _Floats,
    metrics: NDArray[np.float64],
) -> float:
    """`policy loss + value_weight * value loss`, means over the batch.

    Args:
        logits: as of `ppo_loss`, with the next three.
        values: [B, 16], flat.
        by_logits: overwritten.
        by_values: overwritten.
        n_actions: A.
        action_tm1: [B].
        allowed_tm1: [B], the actions that there were to choose from, a bit each.
        least_return_t: [B].
        value_weight: of the critic's loss.
        gains: [B], overwritten with the positive parts of return less value.
        metrics: [at least 4], overwritten; the places are named above.
    """
    count, width = len(action_tm1), len(logits) // len(values) * WIDTH
    share = 1.0 / count
    policy_loss: Any = 0.0
    value_loss: Any = 0.0
    total_gain: Any = 0.0
    positive: Any = 0.0
    for row in range(count):
        z, by_z = logits[row * width : (row + 1) * width], by_logits[row * width : (row + 1) * width]
        by_value = by_values[row * WIDTH : (row + 1) * WIDTH]
        difference: Any = np.float64(least_return_t[row]) - np.float64(values[row * WIDTH])
        gain: Any = max(difference, 0.0)  # what is not a number shall show
        log_total = softmax(z, n_actions, allowed_tm1[row], by_z)
        policy_loss -= (np.float64(z[action_tm1[row]]) - log_total) * gain
        for action in range(n_actions):
            by_z[action] = share * gain * (np.float64(by_z[action]) - (action == action_tm1[row]))
        for k in range(WIDTH):
            by_value[k] = 0
        by_value[0] = -value_weight * share * gain
        value_loss += gain * gain * 0.5
        total_gain += gain
        positive += gain > 0
        gains[row] = gain
    metrics[SIL_POLICY_LOSS], metrics[SIL_VALUE_LOSS] = policy_loss * share, value_loss * share
    metrics[SIL_GAIN], metrics[SIL_POSITIVE_SHARE] = total_gain * share, positive * share
    return float(share * (policy_loss + value_weight * value_loss))


@bare_kernel
def cloning_loss(
    logits: _Floats,
    values: _Floats,
    by_logits: _Floats,
    by_values: _Floats,
    n_actions: int,
    action_tm1: NDArray[np.int64],
    allowed_tm1: NDArray[np.int64],
    return_t: _Floats,
    value_weight: float,
    metrics: NDArray[np.float64],
) -> float:
    """`cross entropy + value_weight * squared error`, means over the batch.

    Args:
        logits: as of `ppo_loss`, with the next three.
        values: [B, 16], flat.
        by_logits: overwritten.
        by_values: overwritten.
        n_actions: A.
        action_tm1: [B], the teacher's.
        allowed_tm1: [B], the actions that there were to choose from, a bit each.
        return_t: [B].
        value_weight: of the critic's loss.
        metrics: [at least 3], overwritten; the places are named above.
    """
    count, width = len(action_tm1), len(logits) // len(values) * WIDTH
    share = 1.0 / count
    cross_entropy: Any = 0.0
    value_loss: Any = 0.0
    agreement: Any = 0.0
    for row in range(count):
        z, by_z = logits[row * width : (row + 1) * width], by_logits[row * width : (row + 1) * width]
        by_value = by_values[row * WIDTH : (row + 1) * WIDTH]
        log_total, taught = softmax(z, n_actions, allowed_tm1[row], by_z), action_tm1[row]
        cross_entropy -= np.float64(z[taught]) - log_total
        agrees = True
        for action in range(n_actions):
            agrees = agrees and by_z[action] <= by_z[taught]
        agreement += agrees
        for action in range(n_actions):
            by_z[action] = share * (np.float64(by_z[action]) - (action == taught))
        for k in range(WIDTH):
            by_value[k] = 0
        error: Any = np.float64(values[row * WIDTH]) - np.float64(return_t[row])
        by_value[0] = value_weight * share * 2.0 * error
        value_loss += error * error
    metrics[CROSS_ENTROPY], metrics[CRITIC_LOSS] = cross_entropy * share, value_loss * share
    metrics[AGREEMENT] = agreement * share
    return float(share * (cross_entropy + value_weight * value_loss))
