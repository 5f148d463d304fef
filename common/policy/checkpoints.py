"""A run's checkpoint as a policy: its network, rebuilt from what the file says of itself, compiled, without torch."""

from dataclasses import dataclass
from pathlib import Path

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig, config_of_science
from railctl.common.policy.compiled import Chooser
from railctl.common.policy.player import chooser_of
from railctl.common.strict import ConfigError


@dataclass(frozen=True)
class SavedPolicy:
    """A checkpoint's network, ready to act, and the run that it comes from, with its world."""

    network: Chooser
    config: RunConfig
    episode: int  # episodes of training


def load_policy(path: Path) -> SavedPolicy:
    """The policy of a checkpoint, for what the trains of its run's world see, and flatland's five actions.

    Raises:
        CheckpointError: one line that says what is wrong with the file.
    """
    tensors, metadata = checkpoint.load(path, "checkpoint")
    try:
        config, episode = config_of_science(metadata["science"]), _episode_of(metadata["episode"])
    except (KeyError, ValueError, ConfigError) as error:
        reason = f" ({error})" if isinstance(error, ConfigError) else ""
        remedy = "use a checkpoint that a run of this version wrote"
        raise CheckpointError(f"{path}: does not say what it needs of its run{reason}: {remedy}") from None
    network = chooser_of(config)
    try:
        network.load(tensors)
    except KeyError as error:
        raise CheckpointError(f"{path}: tensor {error.args[0]} is missing: use another checkpoint") from None
    except ValueError as error:
        raise CheckpointError(f"{path}: {error}: it is of another observation or version of railctl") from None
    return SavedPolicy(network, config, episode)


def _episode_of(text: str) -> int:
    episode = int(text)
    if episode < 0:
        raise ConfigError(f"episode {episode} is below 0")
    return episode
