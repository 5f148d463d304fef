"""railctl levels: the bank of generated levels, pictures, recordings, and levels from and for flatland-rl."""

import typer

from deploy.commands.levels.build import build
from deploy.commands.levels.exchange import export, import_
from deploy.commands.levels.list import list_
from deploy.commands.levels.show import show
from deploy.commands.levels.verify import verify

app = typer.Typer(help="List, build, show, verify, import and export levels.", no_args_is_help=True)
app.command("list")(list_)
app.command()(build)
app.command()(verify)
app.command()(show)
app.command("import")(import_)
app.command()(export)
