"""Action values of sequences that are learned in compiled code."""

import numpy as np

from common.policy.recurrent import RecurrentQNetwork
from common.rules.values import DqnConfig
from services.learner.fused.dqn import METRICS, updated
from services.learner.fused.packed import PackedRecurrent, Training
from services.learner.fused.recurrent_values import update
from services.learner.network.sparse import sparse_rows
from services.learner.training import Batch, Update


class FusedDrqn(Training):
    """Trains a copy of a `RecurrentQNetwork` as `algorithms.dqn.Dqn` does."""

    def __init__(self, config: DqnConfig, network: RecurrentQNetwork) -> None:
        self._config = config
        self._n_actions, self._units = network.n_actions, network.lstm.hidden_size
        hidden = [self._units, *(len(layer.get_parameter("bias")) for layer in network.hidden)]
        heads = {"value": 1, "advantage": network.n_actions}
        self._stack = PackedRecurrent(network.n_features, {"hidden": hidden}, heads)
        super().__init__(network, [self._stack], has_target=config.target_tau is not None)

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the weighted mean squared error, then one of the target network; see `Dqn.update`.

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
            batch.action_tm1.numpy(),
            batch.reward_t.numpy(),
            batch.discount_t.numpy(),
            batch.weights.numpy(),
            self._config.learning_rate,
            np.float32(self._config.target_tau or 0),
            self.steps,
            error_sizes,
            metrics,
        )
        self.steps += made
        return updated(made, error_sizes, metrics)
