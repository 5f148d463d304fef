"""An actor-critic that learns in compiled code."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.first_weights import FirstNetwork
from railctl.common.policy.packing import Layout
from railctl.common.rules.policies import PpoConfig
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.actor_critic import clone, evaluate, imitate, ppo
from railctl.services.learner.fused.packed import VALUES, Packed, Training
from railctl.services.learner.fused.reconsidering import reconsider
from railctl.services.learner.sparse import SparseRows

PPO_NUMBERS = 8  # of an update: what `policy_losses` names, the norm of all gradients, the loss
IMITATION_NUMBERS = 6
CLONING_NUMBERS = 5

Imitation = tuple[NDArray[np.float64], NDArray[np.float32]]


class FusedPolicy(Training):
    """A `services.learner.policy_training.Policy` that has no module."""

    def __init__(self, network: FirstNetwork, learning_rate: float, max_gradient_norm: float) -> None:
        """Gradients are clipped to `max_gradient_norm`, those of actor and critic each."""
        self.n_features, self._n_actions = network.n_features, network.n_actions
        heads = {"actor": network.n_actions, "critic": 1}
        hidden = network.config.hidden
        stacks = [Packed(self.n_features, {f"{part}_hidden": hidden}, {part: width}) for part, width in heads.items()]
        super().__init__(network.weights, stacks, Layout("actor-critic", self.n_features, self._n_actions, hidden))
        self._widths = np.stack([stack.widths for stack in stacks])
        self._learning_rate, self._limit = learning_rate, max_gradient_norm
        self._start = self.arrays[VALUES].copy()

    def values(self, x: SparseRows) -> NDArray[np.float32]:
        """The values [B] of observations [B, F]."""
        values = np.zeros(x.n_rows, np.float32)
        evaluate(self._widths, self.arrays, x.starts, x.columns, x.values, values)
        return values

    def reconsider(self, x: SparseRows, batch: Experience) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """See `services.learner.policy_training.Policy`."""
        log_probabilities, values = np.empty(x.n_rows, np.float32), np.empty(x.n_rows, np.float32)
        reconsider(
            self._widths,
            self.arrays,
            x.starts,
            x.columns,
            x.values,
            self._n_actions,
            batch.action_tm1,
            batch.allowed_tm1,
            log_probabilities,
            values,
        )
        return log_probabilities, values

    def ppo(self, config: PpoConfig, x: SparseRows, batch: Experience, count: int) -> NDArray[np.float64]:
        """Make `count` updates on a batch, or fewer: none is made whose loss is not finite, nor after it.

        Returns:
            [count, 8], the updates' numbers: as `policy_losses` names them, the norm of all gradients, the loss.
        """
        metrics = np.zeros((count, PPO_NUMBERS))
        self.steps += ppo(
            self._widths,
            self.arrays,
            self.seen,
            self._start,
            x.starts,
            x.columns,
            x.values,
            self._n_actions,
            batch.action_tm1,
            batch.allowed_tm1,
            batch.return_t,
            batch.log_probability_tm1,
            batch.value_tm1,
            config.advantages == "standardised",
            config.clip,
            config.value_weight,
            config.entropy_weight,
            config.anchor_weight,
            self._limit,
            self._learning_rate,
            self.steps,
            metrics,
        )
        return metrics

    def imitate(self, value_weight: float, x: SparseRows, batch: Experience) -> Imitation:
        """Make an update of self-imitation, unless its loss is not finite.

        Returns:
            Its numbers [6]: as `policy_losses` names them, the norm of all gradients, the loss. And the gains [B].
        """
        metrics, gains = np.zeros(IMITATION_NUMBERS), np.zeros(x.n_rows, np.float32)
        self.steps += imitate(
            self._widths,
            self.arrays,
            self.seen,
            x.starts,
            x.columns,
            x.values,
            self._n_actions,
            batch.action_tm1,
            batch.allowed_tm1,
            batch.least_return_t,
            value_weight,
            self._limit,
            self._learning_rate,
            self.steps,
            gains,
            metrics,
        )
        return metrics, gains

    def clone(self, value_weight: float, learning_rate: float, x: SparseRows, batch: Experience) -> NDArray[np.float64]:
        """See `services.learner.policy_training.Policy`."""
        metrics = np.zeros(CLONING_NUMBERS)
        self.steps += clone(
            self._widths,
            self.arrays,
            self.seen,
            x.starts,
            x.columns,
            x.values,
            self._n_actions,
            batch.action_tm1,
            batch.allowed_tm1,
            batch.return_t,
            value_weight,
            self._limit,
            learning_rate,
            self.steps,
            metrics,
        )
        return metrics
