"""Action values that are learned in compiled code."""

import numpy as np
from numpy.typing import NDArray

from common.policy.first_weights import FirstNetwork
from common.policy.packing import Layout
from common.rules.values import DqnConfig
from services.learner.fused.action_values import update
from services.learner.fused.packed import Packed, Training
from services.learner.sparse import sparse_rows
from services.learner.training import Batch, Update

METRICS = ("loss", "mean_q", "td_error", "gradient_norm")


class FusedDqn(Training):
    """Trains a network as `textbook.dqn.Dqn` trains a `QNetwork`."""

    def __init__(self, config: DqnConfig, network: FirstNetwork) -> None:
        self._config = config
        self._n_actions, self._dueling = network.n_actions, network.config.kind == "dueling"
        heads = {"value": 1, "advantage": network.n_actions} if self._dueling else {"q": network.n_actions}
        stack = Packed(network.n_features, {"hidden": network.config.hidden}, heads)
        layout = Layout(network.config.kind, network.n_features, network.n_actions, network.config.hidden)
        super().__init__(network.weights, [stack], layout, has_target=config.target_tau is not None)
        self._widths = stack.widths

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the weighted mean squared error, then one of the target network; as `textbook.dqn.Dqn`.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        tm1, t = sparse_rows(batch.observation_tm1), sparse_rows(batch.observation_t)
        error_sizes, metrics = np.empty(len(batch.action_tm1), np.float32), np.zeros(len(METRICS))
        made = update(
            self._widths,
            self.arrays,
            self.seen,
            tm1.starts,
            tm1.columns,
            tm1.values,
            t.starts,
            t.columns,
            t.values,
            self._n_actions,
            self._dueling,
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


def updated(made: bool, error_sizes: NDArray[np.float32], metrics: NDArray[np.float64]) -> Update:
    """What came of an update, by what compiled code filled in.

    Raises:
        FloatingPointError: it was not made, for its loss is not finite.
    """
    if not made:
        raise FloatingPointError(f"the loss is {metrics[0]}: training has diverged, lower dqn.learning_rate")
    return Update(error_sizes, dict(zip(METRICS, metrics.tolist(), strict=True)))
