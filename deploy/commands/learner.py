"""What `pause`, `resume` and `checkpoint` share: a question to the learner."""

from pathlib import Path
from typing import Literal

from railctl.common.bus import Bus
from railctl.common.folder import RunFolder
from railctl.common.records.control import CommandAnswer, LearnerCommand
from railctl.common.wire import keys
from railctl.deploy.far import place_of, reach_far
from railctl.deploy.output import say
from railctl.deploy.runs import find_run, reach

TIMEOUT_S = 20.0  # a snapshot is written before the answer


Verb = Literal["pause", "resume", "checkpoint"]


def ask_learner(run: str | None, folder_of_keys: Path | None, verb: Verb, *, as_json: bool) -> None:
    """Ask the run's learner and print its answer."""
    place = place_of(run, folder_of_keys, "operator")
    if place is None:
        answer = tell_learner(find_run(run), verb)
    else:
        with reach_far(*place) as (bus, _):
            answer = _asked(bus, verb)
    say(answer.text, answer.model_dump(), as_json=as_json)


def tell_learner(folder: RunFolder, verb: Verb) -> CommandAnswer:
    """Ask a run's learner; its answer names the run's folder as the user does.

    Raises:
        NoAnswer: it is not there.
    """
    with reach(folder) as bus:
        answer = _asked(bus, verb)
    return answer.model_copy(update={"text": answer.text.replace(str(folder.path.resolve()), str(folder.path))})


def _asked(bus: Bus, verb: Verb) -> CommandAnswer:
    return bus.ask(keys.COMMAND_LEARNER, LearnerCommand(verb=verb), TIMEOUT_S)
