"""The targets and the update of `algorithms.dqn` as its papers write them, in torch."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from railctl.common.policy.networks import export_tensors, import_tensors
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.sparse import SparseRows, sparse_rows
from railctl.services.learner.textbook.adam import Adam
from railctl.services.learner.textbook.allowing import allowed_only
from railctl.services.learner.textbook.modules import ModuleValues
from railctl.services.learner.textbook.shapes import check_shapes
from railctl.services.learner.training import Batch, Update


def q_target(r_t: Tensor, discount_t: Tensor, q_target_t: Tensor) -> Tensor:
    """Target whose action the target net both picks and scores.

    Mnih et al. 2015; line 14 of the study's Algorithm 2 (line 13 of Algorithm 1 if there is only one net).

    Args:
        r_t: [B].
        discount_t: [B].
        q_target_t: [B, A], of the target net.

    Returns:
        [B].
    """
    check_shapes("B B BA", r_t, discount_t, q_target_t)
    return r_t + discount_t * q_target_t.amax(-1)


def double_q_target(r_t: Tensor, discount_t: Tensor, q_t: Tensor, q_target_t: Tensor) -> Tensor:
    """Target whose action the online net picks and the target net scores.

    "Deep RL with Double Q-learning", van Hasselt et al., arXiv:1509.06461. The study's figure 2.11 has it the other way
    round: there `q_t` is of the target net, and `q_target_t` of the online net.

    Args:
        r_t: [B].
        discount_t: [B].
        q_t: [B, A], of the net that picks.
        q_target_t: [B, A], of the net that scores.

    Returns:
        [B].
    """
    check_shapes("B B BA BA", r_t, discount_t, q_t, q_target_t)
    a_t = q_t.argmax(-1, keepdim=True)  # [B, 1]
    return r_t + discount_t * q_target_t.gather(-1, a_t).squeeze(-1)


def error_gradient(error: Tensor, weights: Tensor, a_tm1: Tensor, n_actions: int) -> Tensor:
    """The gradient of `mean(weights * error^2)` with respect to the action values that the errors come from.

    Args:
        error: [B], of the value of the action taken.
        weights: [B].
        a_tm1: [B], the action taken.
        n_actions: A.

    Returns:
        [B, A].
    """
    check_shapes("B B B", error, weights, a_tm1)
    gradient = torch.zeros(len(error), n_actions)
    return gradient.scatter_(-1, a_tm1.unsqueeze(-1), (weights * error * (2 / len(error))).unsqueeze(-1))


def soft_update(target: Tensor, online: Tensor, tau: float) -> None:
    """Move `target` a share `tau` towards `online`, in place: all parameters of two networks.

    Equation 4.1 of the study, `phi <- (1 - tau) phi + tau theta`; Lillicrap et al. 2016, arXiv:1509.02971.
    """
    check_shapes("P P", target, online)
    target.lerp_(online, tau)


class TensorBatch(NamedTuple):
    """The numbers of a `Batch` in memory of torch's own: its kernels give other bits at other alignments."""

    action_tm1: Tensor  # [B] int64
    reward_t: Tensor  # [B]
    discount_t: Tensor  # [B]
    allowed_t: Tensor  # [B] int64
    weights: Tensor  # [B]

    @classmethod
    def of(cls, batch: Batch) -> "TensorBatch":
        """A copy."""
        return cls(*(torch.tensor(getattr(batch, name)) for name in cls._fields))


class Dqn:
    """Trains a copy of any network of action values, a batch at a time; what `fused` knows learns faster there.

    Attributes:
        online: what is trained.
        target: what scores the next observation; another copy that follows, or `online` itself.
    """

    def __init__(self, config: DqnConfig, network: nn.Module) -> None:
        self._config = config
        self.online = ModuleValues(network)
        self.target = self.online if config.target_tau is None else ModuleValues(network)
        self._adam = Adam(self.online.parameters, config.learning_rate)

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the weighted mean squared error, then one of the target network.

        Returns:
            The batch's errors and `loss`; `mean_q`, of the actions taken, before the step; `td_error`, the mean size of
            the errors; `gradient_norm`, L2 over all parameters.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        tm1 = sparse_rows(batch.observation_tm1)
        own = TensorBatch.of(batch)
        target = self.targets(own, tm1, sparse_rows(batch.observation_t))
        q_tm1 = self.online.forward(tm1)
        taken = q_tm1.gather(-1, own.action_tm1.unsqueeze(-1)).squeeze(-1)
        error = taken - target
        loss = (own.weights * error * error).mean().item()
        if not np.isfinite(loss):
            raise FloatingPointError(f"the loss is {loss}: training has diverged, lower dqn.learning_rate")
        self.online.backward(error_gradient(error, own.weights, own.action_tm1, q_tm1.shape[-1]))
        parameters = self.online.parameters
        gradient_norm = torch.linalg.vector_norm(parameters.flat_gradient).item()
        self._adam.step()
        if self._config.share_an_update:
            self.follow(self._config.share_an_update)
        sizes = error.abs().numpy()
        metrics = {"loss": loss, "mean_q": taken.mean().item(), "td_error": float(sizes.mean(dtype=np.float64))}
        return Update(sizes, metrics | {"gradient_norm": gradient_norm})

    def follow(self, share: float) -> None:
        """Move the target network, which there is, a share towards the online one."""
        soft_update(self.target.parameters.flat, self.online.parameters.flat, share)

    def targets(self, batch: TensorBatch, _tm1: SparseRows, t: SparseRows) -> Tensor:
        """What the values of the actions taken should have been [B]; `_tm1` and `t` are the batch's observations."""
        q_target_t = allowed_only(self.target.forward(t), batch.allowed_t)
        if not self._config.double:
            return q_target(batch.reward_t, batch.discount_t, q_target_t)
        q_t = allowed_only(self.online.forward(t), batch.allowed_t)
        if self._config.double == "reversed":
            q_t, q_target_t = q_target_t, q_t
        return double_q_target(batch.reward_t, batch.discount_t, q_t, q_target_t)

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """A copy of the network's parameters."""
        return export_tensors(self.online.parameters.named(self.online.parameters.flat))

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that updates change: `network/*`, `target/*` and Adam's `steps`, `exp_avg/*`, ..."""
        return export_tensors(self._tensors())

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state`: updates from here on give the same bits as in the learner that gave it.

        Raises:
            ValueError: naming the tensor that does not fit; then nothing has changed.
        """
        import_tensors(self._tensors(), state)

    def _tensors(self) -> dict[str, Tensor]:
        parts = {"network": self.online} | ({} if self.target is self.online else {"target": self.target})
        networks = {
            f"{part}/{name}": tensor
            for part, network in parts.items()
            for name, tensor in network.parameters.named(network.parameters.flat).items()
        }
        return networks | self._adam.tensors()
