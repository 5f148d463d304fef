"""railctl levels verify: check the bank, or replay recorded episodes."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from common.levels.bank import bank_root
from common.strict import ConfigError
from common.task import FAILED
from deploy.commands.levels.options import TASKS, Bank, option
from deploy.output import AsJson, counted, one_line_errors, say
from deploy.runs import runs_root
from deploy.task import run_task

SAMPLE = 100

Recordings = Annotated[
    Path | None, typer.Argument(metavar="FILE", help="Recorded episodes, .npz; default: the bank.", exists=True)
]


@one_line_errors
def verify(
    file: Recordings = None,
    sample: Annotated[
        int | None, typer.Option(help=f"How many of the bank's levels to generate again; default: {SAMPLE}.", min=0)
    ] = None,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Check the bank, or replay the recorded episodes of a file under the rules of flatland 2.2.2.

    Without FILE: every level of the bank against its hash, and a sample against the generator.
    """
    if file is None:
        root = bank or bank_root(runs_root())
        result = run_task(
            TASKS,
            "verify",
            *option("--bank", root),
            *option("--sample", SAMPLE if sample is None else sample),
        )
        say(f"{root}: no change in {counted(result['levels'], 'level')}", result, as_json=as_json)
        return
    if sample is not None or bank is not None:
        raise ConfigError(f"--sample and --bank are for checking the bank: to replay {file}, leave them out")
    result = run_task(TASKS, "replay", str(file))
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
