"""The railctl command line: one verb a file in `deploy.commands`."""

import typer

from deploy.commands.bench import bench
from deploy.commands.checkpoint import checkpoint
from deploy.commands.doctor import doctor
from deploy.commands.down import down
from deploy.commands.evaluate import evaluate
from deploy.commands.levels import app as levels
from deploy.commands.logs import logs
from deploy.commands.pause import pause
from deploy.commands.report import report
from deploy.commands.resume import resume
from deploy.commands.scale import scale
from deploy.commands.status import status
from deploy.commands.study import app as study
from deploy.commands.tail import tail
from deploy.commands.up import up

app = typer.Typer(
    help="Train train dispatchers: an exact, distributed actor-learner system for Flatland.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for verb in (up, status, tail, logs, scale, pause, resume, checkpoint, down, evaluate, report, doctor, bench):
    app.command()(verb)
app.add_typer(levels, name="levels")
app.add_typer(study, name="study")


def main() -> None:
    """Run the command line."""
    app()
