"""railctl tail: every row of a run, from the first on, as it comes."""

import sys
from collections.abc import Iterable
from typing import Annotated

import typer

from railctl.common.bus import NoAnswer
from railctl.common.folder import RunFolder
from railctl.common.locks import living
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.deploy.far import Place, place_of, reach_far
from railctl.deploy.follow import Rows, rows_from_files
from railctl.deploy.output import Keys, RunOrAddress, console, line_width, one_line_errors
from railctl.deploy.runs import find_run, reach
from railctl.deploy.show import row_line

WAIT_S = 0.5

Lines = Annotated[bool, typer.Option("--json", help="Print a JSON document a line.")]


@one_line_errors
def tail(run: RunOrAddress = None, keys: Keys = None, as_json: Lines = False) -> None:
    """Follow a run's episodes and evaluations, with full history, until it ends."""
    place = place_of(run, keys, "reader", "operator")
    try:
        if place is None:
            _follow(find_run(run), as_json=as_json)
        else:
            _follow_far(place, as_json=as_json)
    except KeyboardInterrupt:
        pass


def _follow(folder: RunFolder, *, as_json: bool) -> None:
    try:
        with reach(folder) as bus:
            rows = Rows(bus, folder)
            _print(rows.history(), as_json=as_json)
            while (fresh := rows.next(WAIT_S)) or living(folder):  # asked only when nothing comes: it opens files
                _print(fresh, as_json=as_json)
            _print(rows.history(), as_json=as_json)
    except NoAnswer:
        _print(rows_from_files(folder), as_json=as_json)


def _follow_far(place: Place, *, as_json: bool) -> None:
    """As long as there is a link: the end of a run and a cut look alike from here."""
    with reach_far(*place) as (bus, _):
        rows = Rows(bus, None)
        _print(rows.history(), as_json=as_json)
        while bus.connected():
            _print(rows.next(WAIT_S), as_json=as_json)
        while fresh := rows.next(0.0):
            _print(fresh, as_json=as_json)
    print(f"railctl: no link to {place.address} any more: the run has ended, or tail it again", file=sys.stderr)


def _print(rows: Iterable[EpisodeRow | EvaluationRow], *, as_json: bool) -> None:
    for row in rows:
        if as_json:
            print(row.model_dump_json(by_alias=True), flush=True)
        else:
            console.print(row_line(row, line_width()), markup=False, soft_wrap=True)
