"""`python -m railctl.tools.documents.commands` prints docs/commands.md: all commands, in their own words."""

from collections.abc import Iterator
from typing import Any

import typer

from railctl.deploy.cli import app

HEAD = """# All commands

As `railctl COMMAND --help` says it; made from the code by
`python -m railctl.tools.documents.commands > docs/commands.md`.
What they print, and what to expect of them, is in [using.md](using.md).

Every command takes `--help`. Exit codes: 0 done, 1 failed, 2 wrong usage.
"""


def page() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(_section(path, command) for path, command in commands(typer.main.get_command(app)))])


def commands(command: Any, path: tuple[str, ...] = ("railctl",)) -> Iterator[tuple[tuple[str, ...], Any]]:
    """A command and all below it, each with its words."""
    yield path, command
    for name in getattr(command, "commands", {}):
        yield from commands(command.imported(name), (*path, name))


def _section(path: tuple[str, ...], command: Any) -> str:
    context = typer.Context(command, info_name=" ".join(path))
    words = [piece for piece in command.collect_usage_pieces(context) if piece != "[OPTIONS]"]
    parts = [f"{'###' if len(path) > 2 else '##'} `{' '.join([*path, *words])}`", "", _text(command), ""]
    records = [record for parameter in command.params if (record := parameter.get_help_record(context))]
    if records:
        parts += ["| | |", "|---|---|", *(f"| `{_cell(name)}` | {_cell(text)} |" for name, text in records), ""]
    return "\n".join(parts)


def _text(command: Any) -> str:
    return "\n\n".join(" ".join(part.split()) for part in (command.help or "").split("\n\n"))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def main() -> None:
    print(page(), end="")  # noqa: T201  (who runs it puts it into a file)


if __name__ == "__main__":
    main()
