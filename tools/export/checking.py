"""Whether a model of ONNX says in onnxruntime what our compiled twin says, of drawn and of played observations."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.config import RunConfig
from railctl.common.levels.distributions import LevelFiles
from railctl.common.levels.level import Level
from railctl.common.levels.own import LEVELS
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import SavedPolicy
from railctl.common.policy.compiled import Twin
from railctl.common.policy.player import Acting, play, player
from railctl.common.rail.observations.traffic_shape import EXITS_END, N_EXIT, N_EXITS, N_ROW, N_TRAIN

TOLERANCE = 1e-4  # of an output, in shares of the largest one of its row, or of 1 if that is less
DRAWN, PLAYED, MOST_LEVELS = 500, 500, 5

Floats = NDArray[np.float32]


class Check(NamedTuple):
    """What a comparison came to.

    Attributes:
        drawn: observations that were drawn.
        played: observations out of episodes that the network played.
        largest_difference: of all outputs, in the measure of `TOLERANCE`.
        same_action: of how many the best action is the same.
    """

    drawn: int
    played: int
    largest_difference: float
    same_action: int

    @property
    def holds(self) -> bool:
        return self.largest_difference <= TOLERANCE

    @property
    def text(self) -> str:
        """In a line."""
        count = self.drawn + self.played
        return (
            f"{count} observations ({self.drawn} drawn, {self.played} played): largest difference "
            f"{self.largest_difference:.1e} of {TOLERANCE:.0e}, best action the same in {self.same_action}"
        )


def compare(model: bytes, saved: SavedPolicy, twin: Twin, run: Path) -> Check:
    """Compare a model with the twin of the policy that it was made of, whose run is in a folder, if it is anywhere."""
    drawn = drawn_observations(twin, saved.config)
    played = played_observations(saved, run)
    rows = np.concatenate([drawn, *played])[: DRAWN + PLAYED]
    states = np.random.default_rng(0).uniform(-1, 1, (len(rows), twin.n_state)).astype(np.float32)
    theirs, ours = outputs_of(model, twin, rows, states), outputs_with_state(twin, rows, states)
    scale = np.maximum(1, np.abs(ours).max(-1, keepdims=True))
    n_actions = twin.layout.n_actions
    same = theirs[:, :n_actions].argmax(-1) == ours[:, :n_actions].argmax(-1)
    largest = float((np.abs(theirs - ours) / scale).max())
    return Check(len(drawn), len(rows) - len(drawn), largest, int(same.sum()))


def outputs_with_state(twin: Twin, rows: Floats, states: Floats) -> Floats:
    """[R, O + S]: the twin's outputs, then what its trains carry on."""
    carried = states.copy()
    return np.concatenate([twin.outputs(rows, carried), carried], axis=-1)


def outputs_of(model: bytes, twin: Twin, rows: Floats, states: Floats) -> Floats:
    """[R, O + S]: the same of the model in onnxruntime."""
    import onnxruntime  # noqa: PLC0415  (it takes a second)

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    given: dict[str, Floats] = {"observation": rows} | ({"state": states} if twin.n_state else {})
    wanted = ["logits", "value"] if twin.is_policy else ["q_values", *(["next_state"] if twin.n_state else [])]
    parts: list[Any] = session.run(wanted, given)
    return np.concatenate([part.reshape(len(rows), -1) for part in parts], axis=-1)


def drawn_observations(twin: Twin, config: RunConfig) -> Floats:
    """[500, F]: as many zeros as numbers within the limits; what says that something is there is 0 or 1.

    Of the other trains in a traffic observation those that are there come first, which the compiled twin counts on.
    """
    rng, observation = np.random.default_rng(0), config.world.observation
    rows = rng.uniform(observation.low, observation.high, (DRAWN, twin.layout.n_features)).astype(np.float32)
    rows[rng.random(rows.shape) < 0.5] = 0
    if observation.kind == "traffic":
        flags = [N_TRAIN + N_EXIT * number for number in range(N_EXITS)]
        rows[:, flags] = rng.random((DRAWN, N_EXITS)) < 0.7
        others = rows[:, EXITS_END:].reshape(DRAWN, -1, N_ROW)
        there = np.arange(others.shape[1]) < rng.integers(0, others.shape[1] + 1, (DRAWN, 1))
        others *= there[..., None]
        others[..., 0] = there
    return rows


def played_observations(saved: SavedPolicy, run: Path) -> list[Floats]:
    """What trains see while the network plays a few evaluation levels of its run, greedily: [D, F] of each."""
    found, count = [], 0
    for name, level in _levels(saved.config, run):
        engine = player("compiled", saved.config.world, saved.config.world.levels[name].rules, level.n_trains)
        found.append(play(engine, level, Acting(saved.network, greedy=True)).decisions.observations)
        count += len(found[-1])
        if count >= PLAYED:
            break
    return found


def _levels(config: RunConfig, run: Path) -> Iterator[tuple[str, Level]]:
    """A few of each distribution; none of level files whose run is elsewhere."""
    kept = run / LEVELS
    supply = LevelSupply(config.world.levels, kept=kept)
    for index in range(MOST_LEVELS):
        for name in config.mix:
            levels = config.world.levels[name]
            there = not isinstance(levels, LevelFiles) or kept.is_dir()
            if there and index < levels.evaluation_levels:
                yield name, supply.evaluation(name, index)
