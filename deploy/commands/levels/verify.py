"""railctl levels verify: check the bank."""

from typing import Annotated

import typer

from common.levels.bank import bank_root
from deploy.commands.levels.options import Bank, option
from deploy.levels import run_task
from deploy.output import AsJson, one_line_errors, say
from deploy.runs import runs_root


@one_line_errors
def verify(
    sample: Annotated[int, typer.Option(help="How many levels to generate again.", min=0)] = 100,
    bank: Bank = None,
    as_json: AsJson = False,
) -> None:
    """Check every level of the bank against its hash, and a sample against the generator."""
    root = bank or bank_root(runs_root())
    result = run_task("verify", *option("--bank", root), *option("--sample", sample), quiet=as_json)
    say(f"{root}: {result['levels']} levels are as they were written", result, as_json=as_json)
