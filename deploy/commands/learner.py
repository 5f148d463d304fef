"""What `pause`, `resume` and `checkpoint` share: a question to the learner."""

from typing import Literal

from common.records import LearnerCommand
from common.wire import keys
from deploy.output import say
from deploy.runs import find_run, reach

TIMEOUT_S = 20.0  # a snapshot is written before the answer


def ask_learner(run: str | None, verb: Literal["pause", "resume", "checkpoint"], *, as_json: bool) -> None:
    """Ask the run's learner and print its answer."""
    with reach(find_run(run)) as bus:
        answer = bus.ask(keys.COMMAND_LEARNER, LearnerCommand(verb=verb), TIMEOUT_S)
    say(answer.text, answer.model_dump(), as_json=as_json)
