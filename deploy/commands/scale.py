"""railctl scale: more or fewer actors while training goes on."""

from typing import Annotated

import typer

from railctl.common.bus import Bus
from railctl.common.folder import RunFolder
from railctl.common.records.control import ScaleRequest
from railctl.common.wire.keys import SCALE
from railctl.deploy.far import place_of, reach_far
from railctl.deploy.output import AsJson, Keys, one_line_errors, run_names, say
from railctl.deploy.resolve import parse_actors
from railctl.deploy.runs import Failed, find_run, reach

TIMEOUT_S = 5.0


@one_line_errors
def scale(
    run: Annotated[
        str, typer.Argument(metavar="RUN", help="Name, folder or address of the run.", autocompletion=run_names)
    ],
    counts: Annotated[list[str], typer.Argument(metavar="LEVEL=COUNT", help="For example easy=3 hard=1.")],
    keys: Keys = None,
    as_json: AsJson = False,
) -> None:
    """Change how many actors serve each level; those not named stay as they are."""
    wanted = parse_actors(",".join(counts))
    place = place_of(run, keys, "operator")
    if place is None:
        text = scale_to(find_run(run), wanted)
    else:
        with reach_far(*place) as (bus, _):
            text = ask_to_scale(bus, wanted)
    say(text, {"done": True, "text": text}, as_json=as_json)


def scale_to(folder: RunFolder, counts: dict[str, int]) -> str:
    """Ask the supervisor for these counts; returns its answer.

    Raises:
        Failed: it refused.
        NoAnswer: it is not there.
    """
    with reach(folder) as bus:
        return ask_to_scale(bus, counts)


def ask_to_scale(bus: Bus, counts: dict[str, int]) -> str:
    """The same, over a bus; raises as `scale_to`."""
    answer = bus.ask(SCALE, ScaleRequest(actors=counts), TIMEOUT_S)
    if not answer.done:
        raise Failed(answer.text)
    return answer.text
