# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Acting with a network or its compiled twin: choices for a batch of trains, each as if it were alone."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.common.policy.choosing import NOTHING, choose, draw_counter, is_policy, log_probability
from railctl.common.policy.flat import Arrays
from railctl.common.policy.packing import Layout
from railctl.common.policy.twin import forward
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.play import Choose, Decision


class Choices(NamedTuple):
    """What a batch of R trains does.

    Attributes:
        actions: [R] int8.
        outputs: [R, A] action values, or [R, A + 1] logits and the state's value.
        log_probabilities: [R], of the actions under softmax; zero for value networks.
    """

    actions: NDArray[np.int8]
    outputs: NDArray[np.float32]
    log_probabilities: NDArray[np.float32]


@kernel
def choose_rows(
    header: NDArray[np.int64],
    outputs: NDArray[np.float32],
    allowed: NDArray[np.uint8],
    labels: NDArray[np.int8],
    greedy: bool,
    epsilons: NDArray[np.float64],
    keys: NDArray[np.uint64],
    counters: NDArray[np.uint64],
    actions: NDArray[np.int8],
    log_probabilities: NDArray[np.float32],
) -> None:
    """Choose an action a row, as `choosing.choose`.

    Args:
        header: of the network.
        outputs: [R, O].
        allowed: [R], actions, a bit each.
        labels: [R], what a teacher would do, or NOTHING.
        greedy: take the best; the draws are not looked at.
        epsilons: [R], see `choosing.choose`.
        keys: [R], of the episodes' streams of exploration.
        counters: [R], of the decisions (`choosing.draw_counter`).
        actions: [R], overwritten.
        log_probabilities: [R], overwritten.
    """
    n_actions = header[2]
    for row in range(len(outputs)):
        scores, bits = outputs[row, :n_actions], int(allowed[row])
        action = choose(header, scores, bits, int(labels[row]), greedy, epsilons[row], keys[row], counters[row])
        actions[row] = action
        log_probabilities[row] = log_probability(scores, bits, action) if is_policy(header) else 0.0


class Chooser(Protocol):
    """A network for acting: outputs of one row at a time, so that a train acts as if it were alone.

    Attributes:
        header: of the network, see `common.policy.packing`.
        n_state: S, numbers that a train carries from one decision to the next.
    """

    header: NDArray[np.int64]
    n_state: int

    def load(self, tensors: Arrays) -> None:
        """Take over parameters, by the names that `export_parameters` gives them."""

    def outputs(
        self, observations: NDArray[np.float32], state: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """The outputs [R, O] of observations [R, F]; state [R, S] is carried on in place, zero if not given."""
        raise NotImplementedError

    @property
    def is_policy(self) -> bool:
        """Outputs are logits and the state's value; else action values."""
        return bool(is_policy(self.header))

    def zero_state(self, rows: int) -> NDArray[np.float32]:
        """[R, S]: what trains carry along before their first decision; S is 0 but for recurrent networks."""
        return np.zeros((rows, self.n_state), np.float32)

    def act(
        self,
        observations: NDArray[np.float32],
        epsilons: NDArray[np.float64],
        keys: NDArray[np.uint64],
        counters: NDArray[np.uint64],
        state: NDArray[np.float32] | None = None,
        allowed: NDArray[np.uint8] | None = None,
        labels: NDArray[np.int8] | None = None,
        *,
        greedy: bool = False,
    ) -> Choices:
        """What R trains do; see `choose_rows` and `outputs` for the arguments.

        All actions are allowed, and there is no teacher, if not given.
        """
        outputs = self.outputs(observations, state)
        advice = np.full(len(outputs), NOTHING, np.int8) if labels is None else labels
        bits = np.full(len(outputs), ALL_ACTIONS, np.uint8) if allowed is None else allowed
        actions, log_probabilities = np.empty(len(outputs), np.int8), np.empty(len(outputs), np.float32)
        choose_rows(self.header, outputs, bits, advice, greedy, epsilons, keys, counters, actions, log_probabilities)
        return Choices(actions, outputs, log_probabilities)

    def in_episode(self, epsilon: float, key: int, states: NDArray[np.float32], *, greedy: bool = False) -> Choose:
        """The choices of an episode whose trains carry `states` [N, S] along; see `act` for the other arguments."""
        keys, epsilons = np.array([key], np.uint64), np.array([epsilon])

        def decide(
            observation: NDArray[np.float32], step: int, train: int, allowed: int = ALL_ACTIONS, label: int = NOTHING
        ) -> Decision:
            counters = np.array([draw_counter(step, len(states), train)], np.uint64)
            state = states[train : train + 1]
            told = np.array([allowed], np.uint8), np.array([label], np.int8)
            choices = self.act(observation[None], epsilons, keys, counters, state, *told, greedy=greedy)
            value = float(choices.outputs[0, -1]) if self.is_policy else 0.0
            return Decision(int(choices.actions[0]), float(choices.log_probabilities[0]), value)

        return decide


class Twin(Chooser):
    """A network's compiled twin: `load` its parameters, then ask for outputs or choices."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.header = layout.header
        self.n_state = layout.n_state
        self.parameters = np.zeros(0, np.float32)

    def load(self, tensors: Arrays) -> None:
        """Take over parameters, by the names that `export_parameters` gives them; those in its own order as they lie.

        Raises:
            KeyError, ValueError: as `Order.pack`.
        """
        self.parameters = self.layout.pack(tensors)

    def outputs(
        self, observations: NDArray[np.float32], state: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """The outputs [R, O] of observations [R, F]; state [R, S] is carried on in place, zero if not given."""
        if len(self.parameters) == 0:
            raise ValueError("the twin has no parameters: load some first")
        if observations.ndim != 2 or observations.shape[1] != self.layout.n_features:
            raise ValueError(f"observations have shape {observations.shape}, not [R, {self.layout.n_features}]")
        state = self.zero_state(len(observations)) if state is None else state
        if state.shape != (len(observations), self.layout.n_state):
            raise ValueError(f"state has shape {state.shape}, not {(len(observations), self.layout.n_state)}")
        out = np.empty((len(observations), self.layout.n_outputs), np.float32)
        forward(self.header, self.parameters, np.require(observations, np.float32, ["C", "W"]), state, out)
        return out
