"""Action values of sequences that are learned in compiled code."""

import numpy as np

from common.policy.first_weights import FirstNetwork
from common.policy.packing import Layout
from common.rules.values import DqnConfig
from services.learner.fused.dqn import METRICS, updated
from services.learner.fused.packed import PackedRecurrent, Training
from services.learner.fused.recurrent_values import update
from services.learner.sparse import sparse_rows
from services.learner.training import Batch, Update


class FusedDrqn(Training):
    """Trains a network as `textbook.dqn.Dqn` would train a `RecurrentQNetwork`."""

    def __init__(self, config: DqnConfig, network: FirstNetwork) -> None:
        self._config = config
        self._n_actions, self._units = network.n_actions, network.config.hidden[0]
        heads = {"value": 1, "advantage": network.n_actions}
        self._stack = PackedRecurrent(network.n_features, {"hidden": network.config.hidden}, heads)
        layout = Layout("recurrent", network.n_features, network.n_actions, network.config.hidden)
        super().__init__(network.weights, [self._stack], layout, has_target=config.target_tau is not None)

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the weighted mean squared error, then one of the target network; as `textbook.dqn.Dqn`.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        tm1, t = sparse_rows(batch.observation_tm1), sparse_rows(batch.observation_t)
        error_sizes, metrics = np.empty(len(batch.action_tm1), np.float32), np.zeros(len(METRICS))
        made = update(
            self._stack.widths,
            self._stack.input_width,
            self._units,
            tm1.shape[0],
            self.arrays,
            self.seen,
            tm1.starts,
            tm1.columns,
            tm1.values,
            t.starts,
            t.columns,
            t.values,
            self._n_actions,
            self._config.double,
            batch.action_tm1,
            batch.reward_t,
            batch.discount_t,
            batch.allowed_t,
            batch.weights,
            self._config.learning_rate,
            np.float32(self._config.target_tau or 0),
            self.steps,
            error_sizes,
            metrics,
        )
        self.steps += made
        return updated(made, error_sizes, metrics)
