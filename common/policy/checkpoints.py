"""A run's checkpoint as a policy: its network, rebuilt from what the file says of itself, compiled, without torch."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ValidationError

from common import checkpoint
from common.checkpoint import CheckpointError
from common.config import DIFFICULTIES, Difficulty, Mode, NetworkConfig
from common.policy.compiled import Twin
from common.policy.player import network_layout


@dataclass(frozen=True)
class SavedPolicy:
    """A checkpoint's network, ready to act, and where it comes from."""

    twin: Twin
    algorithm: str
    episode: int  # episodes of training
    trained_on: tuple[Difficulty, ...]
    mode: Mode  # how its run scores it
    seed: int  # of its run, and of the draws with which that scores it

    @property
    def has_probabilities(self) -> bool:
        """Whether its outputs say how likely an action is; action values do not."""
        return self.twin.is_policy


class _Evaluation(BaseModel):
    mode: Mode = "greedy"  # as all were before there was a choice


class _Science(BaseModel):
    """What is needed of a run's configuration, of which an older version may have other keys."""

    algorithm: str
    network: NetworkConfig
    mix: dict[Difficulty, float]
    evaluation: _Evaluation
    seed: int


def load_policy(path: Path) -> SavedPolicy:
    """The policy of a checkpoint, for observations of the study [252] and flatland's five actions.

    Raises:
        CheckpointError: one line that says what is wrong with the file.
    """
    tensors, metadata = checkpoint.load(path, "checkpoint")
    try:
        science, episode = _Science.model_validate_json(metadata["science"]), int(metadata["episode"])
    except (KeyError, ValueError, ValidationError):
        raise CheckpointError(f"{path}: says nothing of its network: use a checkpoint that a run wrote") from None
    twin = Twin(network_layout(science.network))
    try:
        twin.load(tensors)
    except KeyError as error:
        raise CheckpointError(f"{path}: tensor {error.args[0]} is missing: use another checkpoint") from None
    except ValueError as error:
        raise CheckpointError(f"{path}: {error}: it is of another observation or version of railctl") from None
    trained_on = tuple(name for name in DIFFICULTIES if name in science.mix)
    return SavedPolicy(twin, science.algorithm, episode, trained_on, science.evaluation.mode, science.seed)
