"""How commands speak: text for people, one JSON document for programs, one line for errors."""

import json
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn, ParamSpec

import typer
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from common.bus import NoAnswer
from common.process import NO_ROOM
from common.rows import DamagedRows
from common.strict import ConfigError
from common.task import FAILED, WRONG_USAGE
from deploy.runs import Failed

P = ParamSpec("P")

console = Console(highlight=False)
WIDEST = 1000  # characters

RunName = Annotated[str | None, typer.Argument(metavar="RUN", help="Name or folder of the run; default: the newest.")]
RunOrAddress = Annotated[
    str | None,
    typer.Argument(metavar="RUN", help="Name, folder or address (tls/node7:7447) of the run; default: the newest."),
]
Keys = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of keys, for the address of a run.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]


def say(text: str, document: Any, *, as_json: bool) -> None:
    """Print for a person or for a program."""
    if as_json:
        print(json.dumps(document, indent=2))
    else:
        console.print(text, markup=False, soft_wrap=True)


def print_table(table: Table) -> None:
    """Print a table without losing a column: wider than a narrow terminal if it must be, in a file as wide as it is."""
    need = Measurement.get(console, console.options.update(width=WIDEST), table)
    wanted = need.minimum if console.is_terminal else need.maximum
    wide = Console(file=console.file, width=max(console.width, wanted), force_terminal=console.is_terminal)
    wide.print(table)


def counted(number: int, noun: str) -> str:
    """So many of something.

    >>> counted(1, "level"), counted(0, "level")
    ('1 level', '0 levels')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def one_line_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Turn what goes wrong into one line on stderr and an exit code: 2 for wrong usage, 1 for failure."""

    @wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ConfigError as error:
            _end(str(error), WRONG_USAGE)
        except (Failed, NoAnswer, DamagedRows) as error:
            _end(str(error), FAILED)
        except PermissionError as error:
            _end(f"{error.filename}: {error.strerror}: use a folder that you may read and write", FAILED)
        except BrokenPipeError:
            sys.stderr.close()  # the reader of our output has gone, as in `railctl tail | head`
            sys.exit(0)
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            _end(f"{error.strerror}: make room on the disk, then run it again", FAILED)

    return wrapped


def _end(text: str, code: int) -> NoReturn:
    print(f"railctl: {text}", file=sys.stderr)
    sys.exit(code)
