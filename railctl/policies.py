"""Trained policies that act in the caller's process, through the compiled twins of their networks."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.checkpoint import CheckpointError
from railctl.common.policy.checkpoints import load_policy
from railctl.common.rail.world import N_ACTIONS
from railctl.common.strict import ConfigError
from railctl.deploy.runs import find_checkpoint

Floats = NDArray[np.float32]
Memory = dict[str, Floats]


class Policy:
    """A checkpoint's network: observations in, actions out. The best action is taken; of equals the lowest.

    Attributes:
        name: as it was asked for.
        path: of the checkpoint.
        config: of its run, with the world that it knows.
        episode: episodes of training.
        n_features: F, of an observation.
    """

    def __init__(self, name: str | Path) -> None:
        """Load a policy; see `railctl.load_policy`."""
        self.name = str(name)
        self.path = find_checkpoint(self.name)
        try:
            saved = load_policy(self.path)
        except CheckpointError as error:
            raise ConfigError(str(error)) from None
        self._network = saved.network
        self.config = saved.config
        self.episode = saved.episode
        self.n_features = saved.config.world.n_features

    def outputs(self, observations: Any, state: Floats | None = None) -> Floats:
        """What the network says: action values [R, 5], or logits and the state's value [R, 6].

        Args:
            observations: [R, F] float32, scaled as the world's observation is.
            state: [R, S], of a recurrent network, overwritten with what comes after; zeros if not given.

        Raises:
            ValueError: a shape is another, an observation is no number, or `state` is no float32 array that can be
                written.
        """
        if state is not None and not (
            isinstance(state, np.ndarray) and state.dtype == np.float32 and state.flags.carray
        ):
            raise ValueError("state is overwritten: give a float32 array that can be written, in C order")
        outputs = self._network.outputs(np.ascontiguousarray(observations, np.float32), state)
        if math.isnan(np.vdot(outputs, outputs)):  # the quickest way to ask it of all
            raise ValueError("observations hold nan: give numbers, scaled as the world's observation is")
        return outputs

    def act(self, observations: Any, allowed: Any = None, state: Floats | None = None) -> NDArray[np.int64]:
        """[R]: the best action for each of R observations [R, F].

        Args:
            observations: as for `outputs`.
            allowed: [R, 5], true for what a train may do; everything if not given.
            state: as for `outputs`.

        Raises:
            ValueError: as `outputs`, or `allowed` has another shape or leaves a train nothing.
        """
        scores = self.outputs(observations, state)[:, :N_ACTIONS]
        if allowed is not None:
            mask = np.asarray(allowed, np.bool_)
            if mask.shape != scores.shape:
                raise ValueError(f"allowed has shape {mask.shape}, not {scores.shape}: give a row to each observation")
            may_be_empty = np.count_nonzero(mask) <= mask.size - N_ACTIONS  # counted in no time, unlike rows
            if may_be_empty and not mask.any(-1).all():
                raise ValueError("allowed leaves a train nothing to do: allow an action in each row")
            scores = np.where(mask, scores, -np.inf)
        actions: NDArray[np.int64] = scores.argmax(-1)
        return actions

    def actions(
        self, observations: Mapping[str, Floats], infos: Mapping[str, Mapping[str, Any]], memory: Memory | None = None
    ) -> dict[str, int]:
        """What the agents do whose actions count now, from what `reset` or `step` of `railctl.make_env` gave.

        Args:
            observations: by agent.
            infos: by agent; `deciding` and `action_mask` are looked at.
            memory: for recurrent networks, a dictionary of an episode's own, empty at first: what trains carry along.

        Raises:
            ValueError: one of both is no dictionary, or `infos` says nothing of an agent; or as `act`.
        """
        try:
            agents = [agent for agent in observations if infos[agent]["deciding"]]
        except (KeyError, TypeError):
            raise ValueError("infos are not those of the observations: give both as reset or step gave them") from None
        if not agents:
            return {}
        memory = {} if memory is None else memory
        states = [memory.get(agent, self._network.zero_state(1)) for agent in agents]
        state = np.concatenate(states)
        masks = np.array([infos[agent]["action_mask"] for agent in agents])
        chosen = self.act(np.array([observations[agent] for agent in agents]), masks, state)
        memory.update({agent: state[number : number + 1] for number, agent in enumerate(agents)})
        return dict(zip(agents, chosen.tolist(), strict=True))

    def __repr__(self) -> str:
        trained = f"{self.config.algorithm} after {self.episode} episodes, {self.n_features} features"
        return f"Policy({self.name!r}: {trained})"
