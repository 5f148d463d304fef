"""Proximal policy optimisation: several epochs on a whole episode, which is then thrown away.

Schulman et al., "Proximal Policy Optimization Algorithms", 2017, arXiv:1707.06347; section 4.3 and Algorithm 3 of the
study.

Deviations, all of them the study's own text unless said otherwise:
- The critic is clipped too (equation 4.3, after Engstrom et al. 2020, arXiv:2005.12729).
- Advantages are Monte Carlo returns less the value of the critic as it is at each epoch, not as it was when acting; no
  generalised advantage estimate, no minibatches. Returns are scaled, see `services.learner.returns`.
- The gradients of actor and critic, two networks that share nothing, are clipped each.
- Ours: the actor's advantages are standardised over the batch, a common detail (Engstrom et al. 2020). As returns are
  scaled to [-1, 0], they would weigh little beside the entropy bonus otherwise; and while the critic lags behind,
  which it does after each good or bad episode, all actions of an episode would be praised or blamed together.
- Ours: means are over decisions; the text counts the masked steps between them with a loss of zero.
"""

import math
from collections.abc import Mapping
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from common.rules.policies import PolicySettings, PpoConfig
from services.learner.algorithms.shapes import check_shapes
from services.learner.experience import Experience
from services.learner.fused.policy import FusedPolicy
from services.learner.fused.policy_losses import FLOOR
from services.learner.learning import Learning, Trainer
from services.learner.network.policies import PolicyNetwork
from services.learner.network.sparse import SparseRows, sparse_rows
from services.learner.policy_training import PolicyTrainer, build_network

METRICS = ("policy_loss", "value_loss", "entropy", "value_error", "clip_share", "kl", "gradient_norm")


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


class Ppo:
    """Trains an actor-critic, a batch at a time: in compiled code, or by autograd a network that has none."""

    def __init__(self, config: PpoConfig, network: FusedPolicy | PolicyNetwork) -> None:
        self._config = config
        self._network = network

    def update(self, x: SparseRows, batch: Experience, count: int = 1) -> list[dict[str, float]]:
        """Steps of Adam on `-surrogate + c1 * value loss - c2 * entropy`, means over the batch.

        Args:
            x: [B, F], the batch's observations.
            batch: B decisions.
            count: of steps.

        Returns:
            For each step `policy_loss`, `value_loss` and `entropy`; `value_error`, the mean of |R - V|; `clip_share`,
            of decisions whose ratio is out of its limits; `kl`, an estimate of how far the policy is from the one that
            acted (Schulman, "Approximating KL divergence", 2020, k3); `gradient_norm`, L2. All are from before the
            step.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was before this step.
        """
        if isinstance(self._network, PolicyNetwork):
            return [self._step(self._network, x, batch) for _ in range(count)]
        steps = self._network.ppo(self._config, x, batch, count)
        for *_, loss in steps:
            check_finite(loss)
        return [dict(zip(METRICS, numbers, strict=True)) for *numbers, _ in steps.tolist()]

    def _step(self, network: PolicyNetwork, x: SparseRows, batch: Experience) -> dict[str, float]:
        config = self._config
        logits, value = network.outputs(x)
        error = (batch.return_t - value).detach()
        log_ratio = log_probability(logits, batch.action_tm1) - batch.log_probability_tm1
        ratio = log_ratio.exp()
        policy_loss = -clipped_surrogate(ratio, standardised(error), config.clip).mean()
        value_loss = clipped_value_loss(value, batch.value_tm1, batch.return_t, config.clip).mean()
        bonus = entropy(logits).mean()
        loss = policy_loss + config.value_weight * value_loss - config.entropy_weight * bonus
        check_finite(loss.item())
        gradient_norm = network.descend(loss)
        return {
            "policy_loss": policy_loss.item(),
            "value_loss": value_loss.item(),
            "entropy": bonus.item(),
            "value_error": error.abs().mean().item(),
            "clip_share": ((ratio - 1).abs() > config.clip).float().mean().item(),
            "kl": (ratio - 1 - log_ratio).mean().item(),
            "gradient_norm": gradient_norm,
        }


def check_finite(loss: float) -> None:
    """Raises FloatingPointError for a loss that is not a number or infinite."""
    if not math.isfinite(loss):
        raise FloatingPointError(f"the loss is {loss}: training has diverged, lower ppo.learning_rate")


class WholeEpisodes:
    """Every epoch is an update on the whole episode."""

    def __init__(self, config: PpoConfig, network: FusedPolicy | PolicyNetwork) -> None:
        self._epochs = config.epochs
        self._ppo = Ppo(config, network)

    def learn(self, new: Experience) -> list[dict[str, float]]:
        return self._ppo.update(sparse_rows(new.observation_tm1), new, self._epochs)

    def metrics(self) -> dict[str, float]:
        return {}

    def state(self) -> dict[str, NDArray[Any]]:
        return {}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        if state:
            raise ValueError(f"tensor {next(iter(state))} is unknown here: ppo keeps nothing but its network")


def build(learning: Learning[PolicySettings]) -> Trainer:
    """The trainer of a run of `ppo`."""
    network = build_network(learning)
    return PolicyTrainer(learning, network, WholeEpisodes(learning.settings.ppo, network))
