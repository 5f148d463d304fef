"""What several packages' tests have at hand."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from common import checkpoint
from common.config import NetworkConfig
from common.rail.normalise import N_FEATURES
from common.rail.world import N_ACTIONS

DUELING = NetworkConfig(kind="dueling")


@pytest.fixture(scope="session")
def write_checkpoint() -> Callable[..., Path]:
    """Writes a checkpoint as a run does, with random weights: those of seed 4 drive about."""
    from common.policy.actor_critic import build_actor_critic  # noqa: PLC0415  (torch is not for all tests)
    from common.policy.networks import build_network, export_parameters  # noqa: PLC0415
    from common.policy.recurrent import build_recurrent_network  # noqa: PLC0415

    builds = {"actor-critic": build_actor_critic, "recurrent": build_recurrent_network}

    def write(path: Path, network: NetworkConfig = DUELING, seed: int = 4, **changed: str) -> Path:
        tensors = export_parameters(builds.get(network.kind, build_network)(network, N_FEATURES, N_ACTIONS, seed))
        science = {"algorithm": "any", "network": network.model_dump(mode="json"), "mix": {"hard": 0.5, "easy": 0.5}}
        science |= {"evaluation": {"mode": "greedy"}, "seed": seed}
        metadata = {"science": json.dumps(science), "episode": "300"} | changed
        checkpoint.save(path, tensors, metadata, "checkpoint")
        return path

    return write
