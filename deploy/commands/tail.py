"""railctl tail: every row of a run, from the first on, as it comes."""

from collections.abc import Iterable
from typing import Annotated

import typer

from common.bus import NoAnswer
from common.locks import living
from common.records.rows import EpisodeRow, EvaluationRow
from deploy.follow import Rows, rows_from_files
from deploy.output import RunName, console, one_line_errors
from deploy.runs import find_run, reach
from deploy.show import row_line

WAIT_S = 0.5

Lines = Annotated[bool, typer.Option("--json", help="Print a JSON document a line.")]


@one_line_errors
def tail(run: RunName = None, as_json: Lines = False) -> None:
    """Follow a run's episodes and evaluations, with full history, until it ends."""
    folder = find_run(run)
    try:
        with reach(folder) as bus:
            rows = Rows(folder, bus)
            _print(rows.history(), as_json=as_json)
            while living(folder):
                _print(rows.next(WAIT_S), as_json=as_json)
            _print(rows.rest(), as_json=as_json)
    except NoAnswer:
        _print(rows_from_files(folder), as_json=as_json)
    except KeyboardInterrupt:
        pass


def _print(rows: Iterable[EpisodeRow | EvaluationRow], *, as_json: bool) -> None:
    for row in rows:
        if as_json:
            print(row.model_dump_json(by_alias=True), flush=True)
        else:
            console.print(row_line(row), markup=False, soft_wrap=True)
