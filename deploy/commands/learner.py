"""What `pause`, `resume` and `checkpoint` share: a question to the learner."""

from typing import Literal

from railctl.common.records.control import LearnerCommand
from railctl.common.wire import keys
from railctl.deploy.output import say
from railctl.deploy.runs import find_run, reach

TIMEOUT_S = 20.0  # a snapshot is written before the answer


def ask_learner(run: str | None, verb: Literal["pause", "resume", "checkpoint"], *, as_json: bool) -> None:
    """Ask the run's learner and print its answer."""
    folder = find_run(run)
    with reach(folder) as bus:
        answer = bus.ask(keys.COMMAND_LEARNER, LearnerCommand(verb=verb), TIMEOUT_S)
    text = answer.text.replace(str(folder.path.resolve()), str(folder.path))  # as the user calls it
    say(text, answer.model_dump() | {"text": text}, as_json=as_json)
