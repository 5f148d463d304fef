"""railctl resume: go on with a paused run."""

from railctl.deploy.commands.learner import ask_learner
from railctl.deploy.output import AsJson, Keys, RunOrAddress, one_line_errors


@one_line_errors
def resume(run: RunOrAddress = None, keys: Keys = None, as_json: AsJson = False) -> None:
    """Go on with a paused run."""
    ask_learner(run, keys, "resume", as_json=as_json)
