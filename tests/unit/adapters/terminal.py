"""What a user has at hand: a checkpoint, and commands that find the package."""

import json
import os
import subprocess
import sys
from pathlib import Path

from common import checkpoint
from common.config import NetworkConfig
from common.policy.networks import build_network, export_parameters
from common.rail.normalise import N_FEATURES
from common.rail.world import N_ACTIONS

ROOT = Path(__file__).parents[3]
COMMANDS = Path(sys.executable).parent


def write_checkpoint(path, config=NetworkConfig(kind="dueling"), build=build_network, seed=4):  # noqa: B008  (frozen)
    """A checkpoint as a run writes it, with random weights: those of seed 4 drive about."""
    network = build(config, N_FEATURES, N_ACTIONS, seed)
    science = json.dumps({"algorithm": "any", "network": config.model_dump(mode="json"), "mix": {"easy": 1.0}})
    metadata = {"science": science, "episode": "300"}
    checkpoint.save(path, export_parameters(network), metadata, "checkpoint")
    return path


def run_command(folder, *arguments, **environment):
    """Run a command in a folder, with the installed scripts and this source on the paths."""
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment["PATH"] = os.pathsep.join([str(COMMANDS), os.environ["PATH"]])
    return subprocess.run(
        arguments,
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
