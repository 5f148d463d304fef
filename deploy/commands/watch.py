"""railctl watch: runs and studies on a page in the browser."""

from typing import Annotated

import typer

from railctl.deploy.output import console, one_line_errors, run_names
from railctl.deploy.web.catalogue import catalogue_of
from railctl.deploy.web.guard import Keys
from railctl.deploy.web.serving import address, listen, opened, serve


@one_line_errors
def watch(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN|STUDY...",
            help="Names or folders of runs, or names of studies; default: the list of all.",
            autocompletion=run_names,
        ),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Of loopback; default: the first free one from 8710 on.")
    ] = None,
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    read_only: Annotated[bool, typer.Option("--read-only", help="Nobody steers from the page.")] = False,
) -> None:
    """Show runs and studies live in the browser: curves, actors to scale, and trains as they are driven."""
    catalogue = catalogue_of(names or [])
    keys = Keys(read_only=read_only)
    try:
        with listen(port) as listening:
            url = address(listening, catalogue, keys)
            console.print(f"watch    {url}", markup=False, soft_wrap=True)
            if not read_only:
                console.print("this address has a key to steer runs with: keep it to yourself", markup=False)
            console.print("Ctrl-C ends it; runs go on", markup=False)
            if browser:
                with opened(url):
                    serve(catalogue, listening, keys)
            else:
                serve(catalogue, listening, keys)
    except KeyboardInterrupt:
        pass  # before it was served
