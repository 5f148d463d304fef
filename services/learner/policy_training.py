"""Training a policy on one whole episode after another: returns, counters and state, whatever the update rule.

A rule learns from `Experience`, an episode's decisions with their returns; episodes, buses and disks it does not know.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.first_weights import first_actor_critic
from railctl.common.policy.flat import Arrays
from railctl.common.records.acting import Fragment
from railctl.common.records.course import Course
from railctl.common.rules.policies import ActorCriticSettings, PpoConfig
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.policy import FusedPolicy, Imitation
from railctl.services.learner.learning import Learning, by_part, means
from railctl.services.learner.returns import decision_returns, standardised
from railctl.services.learner.sparse import SparseRows, sparse_rows
from railctl.services.learner.vtrace import clipped_ratios, vtrace_targets


class PolicyRule(Protocol):
    """How a policy learns from an episode."""

    def learn(self, new: Experience) -> list[dict[str, float]]:
        """Learn from the decisions of an episode, at least one; returns the metrics of each update."""

    def metrics(self) -> dict[str, float]:
        """The rule's own metrics, by name."""

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything but the network's."""

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state`; ValueError names the tensor that does not fit."""


class Policy(Protocol):
    """An actor-critic and how it learns: in compiled code, or by autograd what has no compiled updates."""

    n_features: int

    def values(self, x: SparseRows) -> NDArray[np.float32]:
        """The values [B] of observations [B, F]."""

    def reconsider(self, x: SparseRows, batch: Experience) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The log-probabilities [B] of a batch's actions, and the values [B] of its observations, as they are now."""

    def ppo(self, config: PpoConfig, x: SparseRows, batch: Experience, count: int) -> NDArray[np.float64]:
        """Make `count` updates of `algorithms.ppo` on a batch; none whose loss is not finite, nor after it.

        Returns:
            [count, 8], the updates' numbers: as `policy_losses` names them, the norm of all gradients, the loss.
        """

    def imitate(self, value_weight: float, x: SparseRows, batch: Experience) -> Imitation:
        """Make an update of `algorithms.sil`, unless its loss is not finite.

        Returns:
            Its numbers [6]: as `policy_losses` names them, the norm of all gradients, the loss. And the gains [B].
        """

    def clone(self, value_weight: float, learning_rate: float, x: SparseRows, batch: Experience) -> NDArray[np.float64]:
        """Make an update of `algorithms.imitate`, unless its loss is not finite.

        Returns:
            Its numbers [5]: as `policy_losses` names them, the norm of all gradients, the loss.
        """

    def weights(self) -> Arrays:
        """A copy of the parameters that actors act with."""

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that updates change."""

    def restore(self, state: Mapping[str, NDArray[np.float32]]) -> None:
        """Take on a `state`; ValueError names the tensor that does not fit."""


def build_network(learning: Learning[ActorCriticSettings], learning_rate: float, max_gradient_norm: float) -> Policy:
    """The network that a run begins with: trained in compiled code, or by autograd if it has none.

    Raises:
        ValueError: naming the tensor of `learning.start` that does not fit.
    """
    settings, sizes = learning.settings, (learning.n_features, learning.n_actions, learning.seed)
    how = learning_rate, max_gradient_norm
    if not settings.learns_with_torch:
        first = first_actor_critic(settings.network, *sizes)
        return FusedPolicy(first if learning.start is None else first._replace(weights=dict(learning.start)), *how)
    from railctl.common.policy.exits import build_exits  # noqa: PLC0415  (torch takes seconds)
    from railctl.common.policy.networks import import_parameters  # noqa: PLC0415
    from railctl.services.learner.textbook.policies import PolicyNetwork  # noqa: PLC0415

    module = settings.module(*sizes) if settings.brings_module else build_exits(settings.network, *sizes)
    if learning.start is not None:
        import_parameters(module, learning.start)
    return PolicyNetwork(module, *how, n_features=learning.n_features)


class PolicyTrainer:
    """A `services.learner.learning.Trainer` around a rule and the network that the rule trains."""

    def __init__(self, learning: Learning[ActorCriticSettings], network: Policy, rule: PolicyRule) -> None:
        self._discount = learning.settings.discount
        self._least_reward = learning.least_reward
        self._network = network
        self._rule = rule
        self._standardises = learning.settings.standardises_returns
        self._corrects = learning.off_policy and learning.settings.learns_from_own_actions

    def train(self, fragment: Fragment) -> dict[str, float]:
        """Learn from a whole episode, whose order `check_order` has passed.

        Returns:
            `updates` and `transitions`, how many there were; the means of the metrics of the updates that have
            them; the metrics of the rule; and of what is corrected `clipped_ratio`, the mean of V-trace's rho.

        Raises:
            ValueError: the episode is a fragment or does not fit the network.
            FloatingPointError: training has diverged.
        """
        episode, decisions = fragment.lease.episode, fragment.course.decisions
        if not fragment.whole:
            raise ValueError(f"episode {episode} is a fragment: a policy learns from whole ones")
        n_features = decisions.observations.shape[1]
        if n_features != self._network.n_features:
            raise ValueError(f"episode {episode} has {n_features} features, the network {self._network.n_features}")
        rows, corrected = self._learn(self._lesson(fragment.course))
        return {
            "updates": float(len(rows)),
            "transitions": float(len(decisions)),
            **means(rows),
            **self._rule.metrics(),
            **corrected,
        }

    def weights(self) -> Arrays:
        """A copy of the parameters that actors act with."""
        return self._network.weights()

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of everything: `learner/*` and `rule/*`."""
        return {
            **{f"learner/{name}": array for name, array in self._network.state().items()},
            **{f"rule/{name}": array for name, array in self._rule.state().items()},
        }

    def restore(self, state: Mapping[str, NDArray[Any]], opened: Sequence[Fragment] = ()) -> None:
        """Take on the `state` of a trainer with the same settings: all that follows is the same to the bit.

        Args:
            state: as `state` gave it.
            opened: fragments of an open episode, which a policy never has.

        Raises:
            ValueError: naming the tensor that is missing, unknown or does not fit.
        """
        if opened:
            raise ValueError(f"episode {opened[0].lease.episode} is a fragment: a policy learns from whole ones")
        parts = by_part(state, "learner", "rule")
        self._network.restore(parts["learner"])
        self._rule.restore(parts["rule"])

    def _lesson(self, course: Course) -> Course:
        """What is to be learned of an episode."""
        return course

    def experience(self, course: Course) -> Experience:
        """What there is to learn from the decisions of a whole episode."""
        following, decisions = self._following(course), course.decisions
        if self._standardises:
            following *= np.float32(1 - self._discount)
        returns = decision_returns(course, following, self._discount)
        least = decision_returns(course, np.full_like(following, self._least_reward), self._discount)
        if self._standardises:
            returns, least = standardised(returns, returns), standardised(least, returns)
        return Experience(
            observation_tm1=_own(decisions.observations),
            action_tm1=decisions.actions.astype(np.int64),
            allowed_tm1=decisions.allowed.astype(np.int64),
            return_t=returns,
            least_return_t=least,
            log_probability_tm1=_own(decisions.log_probabilities),
            value_tm1=_own(decisions.values),
        )

    def _learn(self, course: Course) -> tuple[list[dict[str, float]], dict[str, float]]:
        """The metrics of each update from an episode's decisions, and of what had to be corrected before."""
        if not len(course.decisions):
            return [], {}
        new = self.experience(course)
        if not self._corrects:
            return self._rule.learn(new), {}
        new, ratios = self._corrected(course, new)
        return self._rule.learn(new), {"clipped_ratio": float(ratios.mean())}

    def _following(self, course: Course) -> NDArray[np.float32]:
        """What trains are worth that the step limit stopped [N]."""
        return self._network.values(sparse_rows(_own(course.final_observations)))

    def _corrected(self, course: Course, new: Experience) -> tuple[Experience, NDArray[np.float64]]:
        """What there is to learn now from what older weights did, and V-trace's ratios [D].

        The old policy and values, from which updates keep their distance, are those before the updates: the ratios
        make up for all that has changed since the episode was acted.
        """
        log_probabilities, values = self._network.reconsider(sparse_rows(new.observation_tm1), new)
        ratios = clipped_ratios(log_probabilities, new.log_probability_tm1)
        targets = vtrace_targets(course, self._following(course), self._discount, values, ratios)
        return new._replace(return_t=targets, log_probability_tm1=log_probabilities, value_tm1=values), ratios


def _own(array: NDArray[np.float32]) -> NDArray[np.float32]:
    """A copy that compiled code can take: what came off a wire may lie anyhow."""
    return np.array(array, np.float32, order="C")
