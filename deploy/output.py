"""How commands speak: text for people, one JSON document for programs, one line for errors."""

import errno
import json
import os
import sys
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn, ParamSpec

import typer
from pydantic import BaseModel, ValidationError
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from railctl.common.bus import NoAnswer
from railctl.common.room import NO_ROOM, without_room
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError, brief, describe
from railctl.common.task import FAILED, WRONG_USAGE
from railctl.deploy.runs import Failed, all_runs

P = ParamSpec("P")


class _Output(Console):
    """Whose reader may go, as in `railctl list | head`: `one_line_errors` ends the command."""

    def on_broken_pipe(self) -> NoReturn:
        """Rich would exit with 1."""
        _let_go_of_output()
        raise BrokenPipeError


def _let_go_of_output() -> None:
    """Nobody reads it any more, and the interpreter still flushes at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


console = _Output(highlight=False)
WIDEST = 1000  # characters
LONGEST_LINE = 2000  # characters
NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.ENOENT, errno.EEXIST)


def run_names() -> list[str]:
    """What a shell may complete the name of a run with."""
    return [run.path.name for run in all_runs()]


RunName = Annotated[
    str | None,
    typer.Argument(metavar="RUN", help="Name or folder of the run; default: the newest.", autocompletion=run_names),
]
RunOrAddress = Annotated[
    str | None,
    typer.Argument(
        metavar="RUN",
        help="Name, folder or address (tls/node7:7447) of the run; default: the newest.",
        autocompletion=run_names,
    ),
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
    wide = _Output(file=console.file, width=max(console.width, wanted), force_terminal=console.is_terminal)
    wide.print(table)


def line_width() -> int | None:
    """How wide a line may be: as a terminal is; whoever reads a file or a pipe wants all of it."""
    return console.width if console.is_terminal else None


def counted(number: int, noun: str) -> str:
    """So many of something.

    >>> counted(1, "level"), counted(0, "level")
    ('1 level', '0 levels')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def check_folder_of(path: Path, given: str) -> None:
    """Raise ConfigError if there is no folder for a file that shall be made; `given`: the option with its value."""
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"{given}: there is no folder {path.parent}: make it first")


def check_free(path: Path, given: str) -> None:
    """The same, also if something is there already, be it a link that leads nowhere."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        check_folder_of(path, given)
    else:
        raise ConfigError(f"{given}: exists already: give another name")


def check_replaceable(path: Path, given: str) -> None:
    """As `check_folder_of`, also if a folder is there; a file is replaced."""
    if path.is_dir():
        raise ConfigError(f"{given}: it is a folder: give another name")
    check_folder_of(path, given)


def check_unused(options: Mapping[str, Any], reason: str) -> None:
    """Raise ConfigError if one of these options is given, which has no use there."""
    for option, given in options.items():
        if given is not None:
            raise ConfigError(f"{option} {given}: {reason}")


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
        except ValidationError as error:  # of a request that the options make up
            _end(describe(error, BaseModel), WRONG_USAGE)
        except BrokenPipeError:
            _let_go_of_output()  # of `print`, which does not
            sys.exit(0)
        except OSError as error:
            _end(*_of_the_system(error))

    return wrapped


def _of_the_system(error: OSError) -> tuple[str, int]:
    """What the system complains of, and whether it is for what it was asked."""
    where = f"{brief(str(error.filename), 200)}: " if error.filename else ""  # a write does not know
    if error.errno in NO_ROOM:
        return without_room(error), FAILED
    if isinstance(error, PermissionError):
        return f"{where}{error.strerror}: use a folder that you may read and write", FAILED
    if error.errno in NO_NAME:
        return f"{where}{error.strerror}: give another name or path", WRONG_USAGE
    return f"{where}{error.strerror or error}: mend it, then run it again", FAILED


def _end(text: str, code: int) -> NoReturn:
    """Say it in one line that can be read, whatever names and values are in it."""
    line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)
    if len(line) > LONGEST_LINE:
        line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
    print(f"railctl: {line}", file=sys.stderr)
    sys.exit(code)
