"""Proximal policy optimisation: several epochs on a whole episode, which is then thrown away.

Schulman et al., "Proximal Policy Optimization Algorithms", 2017, arXiv:1707.06347; section 4.3 and Algorithm 3 of the
study.

Deviations, all of them the study's own text unless said otherwise:
- The critic is clipped too (equation 4.3, after Engstrom et al. 2020, arXiv:2005.12729).
- Advantages are Monte Carlo returns less the value of the critic as it is at each epoch, not as it was when acting; no
  generalised advantage estimate, no minibatches. Returns are scaled, see `services.learner.returns`.
- The gradients of actor and critic, two networks that share nothing, are clipped each.
- Ours: the actor's advantages are standardised over the batch, a common detail (Engstrom et al. 2020), unless
  `ppo.advantages` is `plain`. As returns are scaled to [-1, 0], they would weigh little beside the entropy bonus
  otherwise; and while the critic lags behind, which it does after each good or bad episode, all actions of an episode
  would be praised or blamed together.
- Ours: a run that begins with a policy may be held to it: `anchor_weight` times KL(policy || that policy), over the
  actions that were allowed, is added to the loss.
- Ours: means are over decisions; the text counts the masked steps between them with a loss of zero.
"""

import math
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from railctl.common.rules.policies import PolicySettings, PpoConfig
from railctl.services.learner.experience import Experience
from railctl.services.learner.learning import Learning, Trainer
from railctl.services.learner.policy_training import Policy, PolicyTrainer, build_network
from railctl.services.learner.sparse import SparseRows, sparse_rows

METRICS = ("policy_loss", "value_loss", "entropy", "value_error", "clip_share", "kl", "gradient_norm")


class Ppo:
    """Trains an actor-critic, a batch at a time: in compiled code, or by autograd a network that has none."""

    def __init__(self, config: PpoConfig, network: Policy) -> None:
        self._config = config
        self._network = network

    def update(self, x: SparseRows, batch: Experience, count: int = 1) -> list[dict[str, float]]:
        """Steps of Adam on `-surrogate + c1 * value loss - c2 * entropy + c3 * divergence`, means over the batch.

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
        steps = self._network.ppo(self._config, x, batch, count)
        for *_, loss in steps:
            check_finite(loss)
        return [dict(zip(METRICS, numbers, strict=True)) for *numbers, _ in steps.tolist()]


def check_finite(loss: float, rate: str = "ppo.learning_rate") -> None:
    """Raises FloatingPointError for a loss that is not a number or infinite; `rate` is the setting to lower."""
    if not math.isfinite(loss):
        raise FloatingPointError(f"the loss is {loss}: training has diverged, lower {rate}")


class WholeEpisodes:
    """Every epoch is an update on the whole episode."""

    def __init__(self, config: PpoConfig, network: Policy) -> None:
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
    ppo = learning.settings.ppo
    network = build_network(learning, ppo.learning_rate, ppo.max_gradient_norm)
    return PolicyTrainer(learning, network, WholeEpisodes(ppo, network))
