"""railctl pause: hold a run: no new episodes, processes stay."""

from railctl.deploy.commands.learner import ask_learner
from railctl.deploy.output import AsJson, Keys, RunOrAddress, one_line_errors


@one_line_errors
def pause(run: RunOrAddress = None, keys: Keys = None, as_json: AsJson = False) -> None:
    """Hold a run: what is being acted is finished, nothing new begins. It stays paused until railctl resume."""
    ask_learner(run, keys, "pause", as_json=as_json)
