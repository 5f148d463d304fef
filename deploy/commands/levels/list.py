"""railctl levels list: which levels there are."""

from typing import Any

from rich.table import Table

from railctl.common.levels.distributions import AnyLevels, LevelFiles, StockLevels
from railctl.deploy.commands.levels.options import RunFile
from railctl.deploy.levels import known_levels
from railctl.deploy.output import AsJson, one_line_errors, print_table, say

COLUMNS = ("name", "rules", "size", "trains", "cities", "speeds", "malfunctions", "timetable", "held out")


@one_line_errors
def list_(file: RunFile = None, as_json: AsJson = False) -> None:
    """List the levels that runs can be given: those that ship, and those of a run file."""
    rows = [_row(name, levels) for name, levels in known_levels(file).items()]
    if as_json:
        say("", {"levels": rows}, as_json=True)
        return
    table = Table(box=None, pad_edge=False)
    for column in COLUMNS:
        is_number = column in {"trains", "cities", "held out"}
        table.add_column(column, justify="right" if is_number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row))
    print_table(table)


def _row(name: str, levels: AnyLevels) -> dict[str, Any]:
    rows, columns, trains = levels.bounds
    plain: dict[str, Any] = {
        "name": name,
        "rules": levels.rules,
        "size": [rows, columns],
        "trains": trains,
        "cities": None,
        "speeds": None,
        "malfunctions": None,
        "timetable": None,
        "held_out": levels.evaluation_levels,
    }
    if isinstance(levels, LevelFiles):
        found = levels.found
        return plain | {"files": list(levels.files), "training": None if found is None else found.training}
    plain["cities"] = levels.cities
    plain["timetable"] = isinstance(levels, StockLevels) and levels.timetable
    if isinstance(levels, StockLevels):
        plain["speeds"] = (
            None if levels.speeds is None else {f"{speed:g}": part for speed, part in levels.speeds.items()}
        )
        plain["malfunctions"] = levels.malfunctions and levels.malfunctions.model_dump()
    return plain


def _cells(row: dict[str, Any]) -> list[str]:
    """A row as people read it; of files, sizes are those of the largest level."""
    size = f"{row['size'][0]}x{row['size'][1]}"
    head = [row["name"], row["rules"], size, str(row["trains"])]
    if "files" in row:
        return [*head, "", *["files say"] * 3, str(row["held_out"])]
    speeds, broken = row["speeds"] or {"1": 1.0}, row["malfunctions"]
    return [
        *head,
        str(row["cities"]),
        ", ".join(speed if part == 1 else f"{part:.0%} {speed}" for speed, part in speeds.items()),
        "no" if broken is None else f"{broken['rate']:g} ({broken['min_steps']}-{broken['max_steps']})",
        "yes" if row["timetable"] else "no",
        str(row["held_out"]),
    ]
