"""railctl levels verify: check the bank, or replay recorded episodes."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.levels.requests import ReplayRequest, VerifyRequest
from railctl.common.strict import ConfigError
from railctl.common.task import FAILED
from railctl.deploy.commands.levels.options import Bank, RunFile, bank_at
from railctl.deploy.levels import ask, known_levels
from railctl.deploy.output import AsJson, counted, one_line_errors, say

SAMPLE = 100

Recordings = Annotated[
    Path | None, typer.Argument(metavar="FILE", help="Recorded episodes, .npz; default: the bank.", exists=True)
]


@one_line_errors
def verify(
    recordings: Recordings = None,
    file: RunFile = None,
    sample: Annotated[
        int | None, typer.Option(help=f"How many of the bank's levels to generate again; default: {SAMPLE}.", min=0)
    ] = None,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Check the bank, or replay the recorded episodes of a file under the rules of flatland 2.2.2.

    Without FILE: every level of the bank against its hash, and a sample against the generator, of those levels that
    ship and those of the run file given with -f.
    """
    if recordings is None:
        root = bank_at(bank)
        wanted = SAMPLE if sample is None else sample
        result = ask(VerifyRequest(bank=root, levels=known_levels(file), sample=wanted))
        say(f"{root}: no change in {counted(result['levels'], 'level')}", result, as_json=as_json)
        return
    if sample is not None or bank is not None or file is not None:
        raise ConfigError(f"--sample, --bank and -f are for checking the bank: to replay {recordings}, leave them out")
    result = ask(ReplayRequest(file=recordings))
    say(_found(result), result, as_json=as_json)
    if any(result["mismatches"].values()):
        sys.exit(FAILED)


def _found(result: dict[str, Any]) -> str:
    compared = ", ".join(
        counted(result[name], noun)
        for name, noun in (("episodes", "episode"), ("agent_steps", "agent-step"), ("tree_nodes", "tree node"))
    )
    counts = ", ".join(f"{field} {count}" for field, count in result["mismatches"].items())
    lines = [f"{result['file']}: {compared}", f"mismatches: {counts}"]
    first = result["first_mismatch"]
    if first is not None:
        lines.append(f"the first: {_place(first)}: recorded {first['recorded']}, ours {first['ours']}")
    return "\n".join(lines)


def _place(mismatch: dict[str, Any]) -> str:
    parts = ("step", "train", "node", "feature")
    numbers = [f"{part} {mismatch[part]}" for part in parts if mismatch[part] is not None]
    return ", ".join([f"episode {mismatch['episode']}", *numbers, mismatch["field"]])
