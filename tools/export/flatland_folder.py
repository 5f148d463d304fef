"""python -m railctl.tools.export.flatland_folder REQUEST: makes a folder for flatland-rl's own evaluator.

How it answers: see `common.task`.
"""

import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path

from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig
from railctl.common.policy.checkpoints import SavedPolicy, load_policy
from railctl.common.requests import ExportRequest, asked
from railctl.common.task import carry_out, say

SOURCES = {"railctl_policy.py": "flatland_policy.py", "evaluate.py": "flatland_evaluate.py"}

README = """\
# {algorithm} after {episode} episodes, for flatland-rl's own evaluator

`checkpoint.safetensors` is the network that railctl {railctl} trained on {levels} ({rules} rules), and its world:
trains see a `{observation}` observation, decide at `{decisions}`, and act behind the interlocking `{interlocking}`.
The commands below need flatland-rl {flatland} and railctl, which has the code of observation and network.

All levels of a folder, a line each, then the means:

    railctl levels export --level {level} --count 10 --output levels
    python evaluate.py levels/*.pkl

The same by hand, for one level:

    mkdir trajectory
    PYTHONPATH=. flatland-trajectory-generate-from-policy --data-dir trajectory --ep-id first \\
        --env-path levels/{level}_0000.pkl --snapshot-interval 0 \\
        --policy railctl_policy.Policy \\
        --obs-builder railctl_policy.Observation \\
        --rewards railctl_policy.Rewards
    PYTHONPATH=. flatland-trajectory-evaluate --data-dir trajectory --ep-id first --rewards railctl_policy.Rewards
    cat trajectory/event_logs/TrainMovementEvents.trains_arrived.tsv

`normalized_reward` is the normalised return: the rewards of all trains over the number of trains times the step limit.
Leave `--rewards` out of both commands for flatland's own rewards.

{difference}
"""
SAME = """\
The policy was trained under the rules of flatland-rl 4.3.0, which the commands run, so returns are those of `railctl
evaluate` on the same levels, but for malfunctions, which each draws for itself."""
LATER = """\
The policy was trained under the rules of flatland 2.2.2; the commands run those of 4.3.0, under which every train
spends the first step on becoming ready to depart. So everything happens one step later than in `railctl evaluate`, and
every train that arrives pays for one step more: returns are lower by the share that arrives, over the step limit."""


def make(request: ExportRequest) -> None:
    """Make the folder, whole or not at all.

    Raises:
        CheckpointError: the checkpoint cannot be used.
        OSError: the folder cannot be made.
    """
    saved = load_policy(request.checkpoint)
    folder = request.output
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as own:
        made = Path(own) / folder.name
        made.mkdir()
        shutil.copyfile(request.checkpoint, made / "checkpoint.safetensors")
        for name, source in SOURCES.items():
            shutil.copyfile(Path(__file__).with_name(source), made / name)
        (made / "README.md").write_text(readme(saved))
        made.rename(folder)
    files = sorted(path.name for path in folder.iterdir())
    say({"folder": str(folder), "checkpoint": str(request.checkpoint), "files": files})


def readme(saved: SavedPolicy) -> str:
    """What the folder says of itself."""
    config, world = saved.config, saved.config.world
    is_stock = "stock" in _rules(config)
    return README.format(
        algorithm=config.algorithm,
        episode=saved.episode,
        railctl=version("railctl"),
        flatland=version("flatland-rl"),
        levels=", ".join(config.mix),
        level=next(iter(config.mix)),
        rules=" and ".join(sorted(_rules(config))),
        observation=world.observation.kind,
        decisions=world.decisions,
        interlocking=world.interlocking,
        difference=SAME if is_stock else LATER,
    )


def _rules(config: RunConfig) -> set[str]:
    return {config.world.levels[name].rules for name in config.mix}


def main() -> None:
    carry_out(lambda: make(asked(ExportRequest)), CheckpointError)


if __name__ == "__main__":
    main()
