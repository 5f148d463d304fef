"""What several packages' tests have at hand."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from railctl.common import checkpoint
from railctl.common.config import Plain, parse_config
from railctl.common.rail.world import N_ACTIONS
from railctl.common.rules.settings import NetworkConfig

DUELING = NetworkConfig(kind="dueling")
RULES = {"actor-critic": "ppo", "recurrent": "drqn"}  # by kind of network; others are dqn's
VALUES = {
    "dqn": {"learning_rate": 0.1, "batch_size": 1, "learn_every_steps": 1},
    "replay": {"kind": "uniform", "capacity": 1},
}
STUDY: Plain = {"mix": {"hard": 0.5, "easy": 0.5}}
POLICY = {"ppo": {"learning_rate": 0.1, "epochs": 1}}


@pytest.fixture(scope="session")
def write_checkpoint() -> Callable[..., Path]:
    """Writes a checkpoint as a run does, with random weights: those of seed 4 drive about.

    `world` are the keys of a run file that say what world the run had.
    """
    from railctl.common.policy.actor_critic import build_actor_critic  # noqa: PLC0415  (torch is not for all tests)
    from railctl.common.policy.networks import build_network, export_parameters  # noqa: PLC0415
    from railctl.common.policy.recurrent import build_recurrent_network  # noqa: PLC0415

    builds = {"actor-critic": build_actor_critic, "recurrent": build_recurrent_network}

    def write(
        path: Path, network: NetworkConfig = DUELING, seed: int = 4, world: Plain = STUDY, **changed: str
    ) -> Path:
        rule = RULES.get(network.kind, "dqn")
        config = parse_config(
            {
                "algorithm": "any",
                "rule": rule,
                **world,
                "episodes": 300,
                "seed": seed,
                "network": network.model_dump(mode="json"),
                **(POLICY if rule == "ppo" else VALUES),
                "cluster": {"actors": {"any": 1}},
            }
        )
        build = builds.get(network.kind, build_network)
        tensors = export_parameters(build(network, config.world.n_features, N_ACTIONS, seed))
        metadata = {"science": json.dumps(config.science), "episode": "300"} | changed
        checkpoint.save(path, tensors, metadata, "checkpoint")
        return path

    return write
