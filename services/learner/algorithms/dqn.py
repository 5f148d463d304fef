"""Deep Q-learning and its variants: one learner, with switches in `NetworkConfig` and `DqnConfig`.

| preset | `dqn.target_tau` | `dqn.double` | `network.kind` | paper |
|---|---|---|---|---|
| `dqn` | none | no | plain | Mnih et al., "Human-level control through deep RL", 2015 |
| `ddqn` | a share | no | plain | as above, soft target as in Lillicrap et al. 2016, arXiv:1509.02971 |
| `dddqn` | a share | no | dueling | Wang et al., "Dueling Network Architectures", arXiv:1511.06581 |

`double` gives `ddqn` and `dddqn` the classic rule of van Hasselt et al., "Deep RL with Double Q-learning",
arXiv:1509.06461.

Deviations, all of them the study's own text unless said otherwise:
- `dqn` has no target network: its target is the network itself, detached.
- The target of `ddqn` and `dddqn` is the maximum of the target network (the text's Algorithm 2), unless
  `double`.
- The target network takes a share of the online one after each update (the text's equation 4.1) and is never
  copied.
- The loss is the plain mean squared error; neither the error nor the gradient is clipped.
- Ours: transitions span several steps, so `discount_t` is gamma to the power of the span
  (`replay/transitions.py`).
"""

import copy
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.config import DqnConfig
from common.policy.networks import QNetwork, export_tensors, import_tensors


class Batch(NamedTuple):
    """B transitions; fields as in `Transitions`."""

    observation_tm1: Tensor  # [B, F] float32
    action_tm1: Tensor  # [B] int64
    reward_t: Tensor  # [B] float32
    discount_t: Tensor  # [B] float32
    observation_t: Tensor  # [B, F] float32


def q_target(r_t: Tensor, discount_t: Tensor, q_target_t: Tensor) -> Tensor:
    """Target whose action the target net both picks and scores.

    Mnih et al. 2015; line 14 of the study's Algorithm 2 (line 13 of Algorithm 1 if there is only one net).

    Args:
        r_t: [B].
        discount_t: [B].
        q_target_t: [B, A], of the target net.

    Returns:
        [B], detached.
    """
    return (r_t + discount_t * q_target_t.amax(-1)).detach()


def double_q_target(r_t: Tensor, discount_t: Tensor, q_t: Tensor, q_target_t: Tensor) -> Tensor:
    """Target whose action the online net picks and the target net scores.

    "Deep RL with Double Q-learning", van Hasselt et al., arXiv:1509.06461.

    Args:
        r_t: [B].
        discount_t: [B].
        q_t: [B, A], of the online net.
        q_target_t: [B, A], of the target net.

    Returns:
        [B], detached.
    """
    a_t = q_t.argmax(-1, keepdim=True)  # [B, 1]
    return (r_t + discount_t * q_target_t.gather(-1, a_t).squeeze(-1)).detach()


@torch.no_grad()
def soft_update(target: nn.Module, online: nn.Module, tau: float) -> None:
    """Move each parameter of `target` a share `tau` towards `online`, in place.

    Equation 4.1 of the study, `phi <- (1 - tau) phi + tau theta`; Lillicrap et al. 2016, arXiv:1509.02971.
    """
    for phi, theta in zip(target.parameters(), online.parameters(), strict=True):
        phi.lerp_(theta, tau)


class Dqn:
    """Trains a network in place, a batch at a time."""

    def __init__(self, config: DqnConfig, network: QNetwork) -> None:
        """The target network, if there is one, starts as a copy of `network`."""
        self._config = config
        self._network = network
        self._target = None if config.target_tau is None else copy.deepcopy(network).requires_grad_(False)
        self._adam = torch.optim.Adam(network.parameters(), lr=config.learning_rate, fused=True)
        for parameter in network.parameters():  # now, not on the first step, so that a state always has all tensors
            self._adam.state[parameter] = {
                "step": torch.zeros(()),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }

    def update(self, batch: Batch) -> dict[str, float]:
        """One step of Adam on the mean squared error, then one of the target network.

        Returns:
            `loss`; `mean_q`, of the actions taken, before the step; `gradient_norm`, L2 over all parameters.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        q_tm1 = self._network(batch.observation_tm1).gather(-1, batch.action_tm1.unsqueeze(-1)).squeeze(-1)
        loss = nn.functional.mse_loss(q_tm1, self._targets(batch))
        value = loss.item()
        if not math.isfinite(value):
            raise FloatingPointError(f"the loss is {value}: training has diverged, lower dqn.learning_rate")
        self._adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        gradients = [p.grad for p in self._network.parameters() if p.grad is not None]
        gradient_norm = nn.utils.get_total_norm(gradients).item()
        self._adam.step()
        if self._target is not None and self._config.target_tau is not None:
            soft_update(self._target, self._network, self._config.target_tau)
        return {"loss": value, "mean_q": q_tm1.mean().item(), "gradient_norm": gradient_norm}

    def state(self) -> dict[str, NDArray[np.float32]]:
        """A copy of all that updates change: `network/*`, `target/*` and Adam's `step/*`, `exp_avg/*`, ..."""
        return export_tensors(self._tensors())

    def restore(self, state: Mapping[str, NDArray[np.float32]]) -> None:
        """Take on a `state`: updates from here on give the same bits as in the learner that gave it.

        Raises:
            ValueError: naming the tensor that does not fit; then nothing has changed.
        """
        import_tensors(self._tensors(), state)

    @torch.no_grad()
    def _targets(self, batch: Batch) -> Tensor:
        q_target_t = (self._target or self._network)(batch.observation_t)
        if not self._config.double:
            return q_target(batch.reward_t, batch.discount_t, q_target_t)
        q_t = self._network(batch.observation_t)
        return double_q_target(batch.reward_t, batch.discount_t, q_t, q_target_t)

    def _tensors(self) -> dict[str, Tensor]:
        tensors: dict[str, Tensor] = {}
        for name, parameter in self._network.named_parameters():
            tensors[f"network/{name}"] = parameter
            for moment, tensor in self._adam.state[parameter].items():
                tensors[f"{moment}/{name}"] = tensor
        if self._target is not None:
            tensors |= {f"target/{name}": parameter for name, parameter in self._target.named_parameters()}
        return tensors
