"""railctl resume: go on with a paused run."""

from railctl.deploy.commands.learner import ask_learner
from railctl.deploy.output import AsJson, RunName, one_line_errors


@one_line_errors
def resume(run: RunName = None, as_json: AsJson = False) -> None:
    """Go on with a paused run."""
    ask_learner(run, "resume", as_json=as_json)
