"""railctl checkpoint: write a checkpoint and a snapshot now."""

from railctl.deploy.commands.learner import ask_learner
from railctl.deploy.output import AsJson, Keys, RunOrAddress, one_line_errors


@one_line_errors
def checkpoint(run: RunOrAddress = None, keys: Keys = None, as_json: AsJson = False) -> None:
    """Write a checkpoint and a snapshot now; the checkpoint is evaluated like any other."""
    ask_learner(run, keys, "checkpoint", as_json=as_json)
