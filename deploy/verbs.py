"""Groups of verbs, each imported when it is given: a help page or a quick verb does not wait for what others need."""

import importlib
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from railctl.common.text import is_text

NOTHING_GIVEN = re.compile(r"--[^=]*=")  # an option without its value


class Verb(NamedTuple):
    """What a help page says of a verb, and where it is: a function, or the `Typer` of a group, as `module:name`."""

    place: str
    line: str


class Verbs(TyperGroup):
    """A group whose `commands` know only their names and lines, until one of them is given."""

    verbs: Mapping[str, Verb]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the words of a command line, none of which is empty, and all of which are text."""
        for place, word in enumerate(args):
            if not word or NOTHING_GIVEN.fullmatch(word):
                before = word[:-1] or (args[place - 1] if place else "railctl")
                raise typer.BadParameter(f"{before:.80}: what follows is empty, give it a value", ctx=ctx)
            if not is_text(word):
                raise typer.BadParameter(f"{word!a:.80} is not text in UTF-8: rename it", ctx=ctx)
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that is given, in full."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else self.imported(name), rest

    def imported(self, name: str) -> Any:
        """A command in full."""
        module, _, attribute = self.verbs[name].place.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if not isinstance(found, typer.Typer):
            app = _app()
            app.command(name)(found)
            return typer.main.get_command(app)
        return typer.main.get_command(found)


def group(text: str, verbs: Mapping[str, Verb], *, completes: bool = False) -> typer.Typer:
    """A group of verbs and what its help page says of it; the whole command line has shells complete it."""
    app = _app(
        add_completion=completes,
        cls=type("Verbs", (Verbs,), {"verbs": verbs}),
        help=text,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_only_named)  # a group of one verb would else be that verb
    for name, verb in verbs.items():
        app.command(name, help=verb.line)(_only_named)
    return app


def _app(**settings: Any) -> typer.Typer:
    return typer.Typer(pretty_exceptions_enable=False, **{"add_completion": False} | settings)


def _only_named() -> None:
    """Stands for a verb that is not imported."""
