"""Action values that are learned in compiled code."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from railctl.common.policy.first_weights import FirstNetwork
from railctl.common.policy.packing import Layout
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.fused import action_values, values_apart
from railctl.services.learner.fused.packed import TARGET, VALUES, Packed, Training
from railctl.services.learner.sparse import sparse_rows
from railctl.services.learner.training import Batch, Update

METRICS = ("loss", "mean_q", "td_error", "gradient_norm")


class FusedValues(Training):
    """Trains a network as `textbook.dqn.Dqn` trains a module."""

    def __init__(
        self, config: DqnConfig, network: FirstNetwork, stacks: Sequence[Packed], compiled: Callable[..., bool]
    ) -> None:
        """`compiled` makes an update of this kind of network; it takes all that `update` below gives it."""
        layout = Layout(network.config.kind, network.n_features, network.n_actions, network.config.hidden)
        super().__init__(network.weights, stacks, layout, has_target=config.target_tau is not None)
        self._config, self._n_actions = config, network.n_actions
        self._picking, self._scoring = roles(config)
        self._compiled = compiled

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the weighted mean squared error, then one of the target network; as `textbook.dqn.Dqn`.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        tm1, t = sparse_rows(batch.observation_tm1), sparse_rows(batch.observation_t)
        error_sizes, metrics = np.empty(len(batch.action_tm1), np.float32), np.zeros(len(METRICS))
        made = self._compiled(
            self.arrays,
            self.seen,
            tm1.starts,
            tm1.columns,
            tm1.values,
            t.starts,
            t.columns,
            t.values,
            self._n_actions,
            self._picking,
            self._scoring,
            batch.action_tm1,
            batch.reward_t,
            batch.discount_t,
            batch.allowed_t,
            batch.weights,
            self._config.learning_rate,
            np.float32(self._config.share_an_update),
            self.steps,
            error_sizes,
            metrics,
        )
        if not made:
            raise FloatingPointError(f"the loss is {metrics[0]}: training has diverged, lower dqn.learning_rate")
        self.steps += 1
        return Update(error_sizes, dict(zip(METRICS, metrics.tolist(), strict=True)))


class FusedDqn(FusedValues):
    """For networks of the kinds `plain` and `dueling`."""

    def __init__(self, config: DqnConfig, network: FirstNetwork) -> None:
        dueling = network.config.kind == "dueling"
        heads = {"value": 1, "advantage": network.n_actions} if dueling else {"q": network.n_actions}
        stack = Packed(network.n_features, {"hidden": network.config.hidden}, heads)
        super().__init__(config, network, [stack], partial(action_values.update, stack.widths, dueling))


class FusedApart(FusedValues):
    """For networks of the kind `dueling-apart`."""

    def __init__(self, config: DqnConfig, network: FirstNetwork) -> None:
        hidden, heads = network.config.hidden, {"advantage": network.n_actions, "value": 1}
        stacks = [Packed(network.n_features, {f"{head}_hidden": hidden}, {head: heads[head]}) for head in heads]
        widths = np.stack([stack.widths for stack in stacks])
        super().__init__(config, network, stacks, partial(values_apart.update, widths))


def roles(config: DqnConfig) -> tuple[int, int]:
    """Rows of `Training.arrays`: whose network picks the actions that targets are of, and whose scores them."""
    target = VALUES if config.target_tau is None else TARGET
    if config.double == "reversed":
        return TARGET, VALUES
    return VALUES if config.double else target, target
