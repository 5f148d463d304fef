"""python -m railctl.tools.export.onnx_file REQUEST: writes a checkpoint's network as a checked model of ONNX.

How it answers: see `common.task`. What a model takes and gives: `tools.export.networks`.
"""

import json
from importlib.metadata import version

from railctl.common import checkpoint
from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig
from railctl.common.folder import write_atomically
from railctl.common.levels.chunks import BankError
from railctl.common.levels.files import LevelFileError
from railctl.common.policy.checkpoints import SavedPolicy, load_policy
from railctl.common.policy.compiled import Twin
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, STOP_MOVING
from railctl.common.requests import ExportRequest, asked
from railctl.common.strict import ConfigError
from railctl.common.task import carry_out, say
from railctl.tools.export.checking import TOLERANCE, compare
from railctl.tools.export.networks import ends_of, model_of

ACTIONS = {
    DO_NOTHING: "DO_NOTHING",
    MOVE_LEFT: "MOVE_LEFT",
    MOVE_FORWARD: "MOVE_FORWARD",
    MOVE_RIGHT: "MOVE_RIGHT",
    STOP_MOVING: "STOP_MOVING",
}


class DiffersError(Exception):
    """A model does not say what our own network says."""


def export(request: ExportRequest) -> None:
    """Write the model, unless it differs from the compiled twin.

    Raises:
        ConfigError: the network is a module of the rule's own.
        CheckpointError: the checkpoint cannot be used.
        DiffersError: the model and the twin say different things.
    """
    tensors, labels = checkpoint.load(request.checkpoint, "checkpoint")
    saved = load_policy(request.checkpoint)
    twin = saved.network
    if not isinstance(twin, Twin):
        raise ConfigError(
            f"{request.checkpoint}: its network is a module of the rule {saved.config.rule}: have torch.onnx.export "
            "write it, from Python"
        )
    metadata = metadata_of(saved, twin, labels["digest"])
    model = model_of(twin.layout, tensors, metadata, f"{saved.config.algorithm} after {saved.episode} episodes")
    check = compare(model.SerializeToString(), saved, twin, request.checkpoint.parent.parent)
    if not check.holds:
        raise DiffersError(
            f"{request.output} was not written: in onnxruntime {version('onnxruntime')} the model differs by "
            f"{check.largest_difference:.1e} from our network, more than {TOLERANCE:.0e}: use another version"
        )
    write_atomically(request.output, model.SerializeToString())
    inputs, outputs = ends_of(twin.layout)
    say(
        {
            "file": str(request.output),
            "checkpoint": str(request.checkpoint),
            "bytes": request.output.stat().st_size,
            "inputs": inputs,
            "outputs": outputs,
            "check": check.text,
            **check._asdict(),
        }
    )


def metadata_of(saved: SavedPolicy, twin: Twin, digest: str) -> dict[str, str]:
    """What a model says of itself: strings, those that begin with a bracket are JSON."""
    config = saved.config
    return {
        "railctl": version("railctl"),
        "algorithm": config.algorithm,
        "rule": config.rule,
        "episode": str(saved.episode),
        "network": twin.layout.kind,
        "observation": config.world.observation.model_dump_json(),
        "observation_range": json.dumps([config.world.observation.low, config.world.observation.high]),
        "normalisation": _normalisation(config),
        "actions": json.dumps(list(ACTIONS.values())),
        "mode": config.evaluation.mode,
        "decisions": config.world.decisions,
        "interlocking": config.world.interlocking,
        "checkpoint_digest": digest,
        "science": json.dumps(config.science, sort_keys=True),
    }


def _normalisation(config: RunConfig) -> str:
    observation = config.world.observation
    scaled = f"the observation is scaled already, to [{observation.low:g}, {observation.high:g}]; 0: nothing there"
    return f"{scaled}; features {observation.features}" if observation.kind == "tree" else scaled


def main() -> None:
    carry_out(lambda: export(asked(ExportRequest)), CheckpointError, LevelFileError, BankError, DiffersError)


if __name__ == "__main__":
    main()
