"""Action values of sequences that are learned in compiled code."""

from functools import partial

from railctl.common.policy.first_weights import FirstNetwork
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.fused import recurrent_values
from railctl.services.learner.fused.dqn import FusedValues
from railctl.services.learner.fused.packed import PackedRecurrent


class FusedDrqn(FusedValues):
    """For networks of the kind `recurrent`, and batches of sequences."""

    def __init__(self, config: DqnConfig, network: FirstNetwork) -> None:
        hidden, heads = network.config.hidden, {"value": 1, "advantage": network.n_actions}
        stack = PackedRecurrent(network.n_features, {"hidden": hidden}, heads)
        compiled = partial(recurrent_values.update, stack.widths, stack.input_width, hidden[0])
        super().__init__(config, network, [stack], compiled)
