"""railctl study: many runs that are compared: what they will take, carrying them out, how far they are, the report."""

import typer

from deploy.commands.study.plan import plan
from deploy.commands.study.report import report
from deploy.commands.study.run import run
from deploy.commands.study.status import status

app = typer.Typer(help="Plan, run, watch and report on studies: many runs that are compared.", no_args_is_help=True)
app.command()(plan)
app.command()(run)
app.command()(status)
app.command()(report)
