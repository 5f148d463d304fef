"""What a page asks a run to do: the same that the command line does, asked in the same way."""

from typing import Annotated, Literal

from pydantic import Field

from railctl.common.config import MAX_ACTORS
from railctl.common.folder import RunFolder
from railctl.common.levels.distributions import LevelName
from railctl.common.strict import ConfigError, Strict
from railctl.deploy.commands.down import ask_to_stop
from railctl.deploy.commands.learner import tell_learner
from railctl.deploy.commands.scale import scale_to
from railctl.deploy.runs import Failed, supervised


class Steer(Strict):
    """A command to a run; `actors` are those of `scale`, by level."""

    run: Annotated[str, Field(max_length=400)]
    verb: Literal["scale", "pause", "resume", "checkpoint", "down"]
    actors: dict[LevelName, Annotated[int, Field(ge=0, le=MAX_ACTORS)]] = Field(default_factory=dict)


def steer(folder: RunFolder, command: Steer) -> str:
    """Carry out a command; returns what the run answers.

    Raises:
        ConfigError: it lacks something.
        Failed: the run refused.
        NoAnswer: it is not there.
    """
    if command.verb == "scale":
        if not command.actors:
            raise ConfigError("actors is empty: say for which levels there shall be how many")
        return scale_to(folder, command.actors)
    if command.verb == "down":
        if not supervised(folder):
            raise Failed(f"run {folder.path.name} has no supervisor: railctl down {folder.path.name} ends what is left")
        ask_to_stop(folder)
        return f"run {folder.path.name} stops; railctl up --name {folder.path.name} goes on"
    answer = tell_learner(folder, command.verb)
    if not answer.done:
        raise Failed(answer.text)
    return answer.text
