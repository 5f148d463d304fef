"""A run's checkpoint as a policy: its network, rebuilt from what the file says of itself, compiled, without torch."""

import json
from pathlib import Path

from pydantic import ValidationError

from common import checkpoint
from common.checkpoint import CheckpointError
from common.config import NetworkConfig
from common.policy.compiled import Twin
from common.policy.packing import Arrays, Kind, Layout
from common.rail.normalise import N_FEATURES
from common.rail.world import N_ACTIONS

KIND_SIGNS: tuple[tuple[str, Kind], ...] = (  # a parameter that only this kind has; the first that fits
    ("lstm.weight_ih_l0", "recurrent"),
    ("actor.weight", "actor-critic"),
    ("advantage.weight", "dueling"),
    ("q.weight", "plain"),
)


def load_twin(path: Path) -> Twin:
    """The compiled network of a checkpoint, for observations of the study [252] and flatland's five actions.

    Its widths are those of the run's configuration, which the file carries; its kind shows in its parameters.

    Raises:
        CheckpointError: one line that says what is wrong with the file.
    """
    tensors, metadata = checkpoint.load(path, "checkpoint")
    try:
        network = NetworkConfig.model_validate(json.loads(metadata["science"])["network"])
    except (KeyError, TypeError, ValueError, ValidationError):
        raise CheckpointError(f"{path}: says nothing of its network: use a checkpoint that a run wrote") from None
    twin = Twin(Layout(_kind(path, tensors), N_FEATURES, N_ACTIONS, network.hidden))
    try:
        twin.load(tensors)
    except KeyError as error:
        raise CheckpointError(f"{path}: tensor {error.args[0]} is missing: use another checkpoint") from None
    except ValueError as error:
        raise CheckpointError(f"{path}: {error}: it is of another observation or version of railctl") from None
    return twin


def _kind(path: Path, tensors: Arrays) -> Kind:
    for name, kind in KIND_SIGNS:
        if name in tensors:
            return kind
    raise CheckpointError(f"{path}: holds no network that acts: use a checkpoint that a run wrote")
