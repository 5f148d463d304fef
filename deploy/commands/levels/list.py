"""railctl levels list: which levels there are."""

from typing import Any

from common.levels.distributions import AnyLevels, LevelFiles, StockLevels
from deploy.commands.levels.options import RunFile
from deploy.levels import known_levels
from deploy.output import AsJson, one_line_errors, print_table, say
from deploy.show import named_table

COLUMNS = ("name", "rules", "size", "trains", "speeds", "malfunctions", "timetable", "held out")


@one_line_errors
def list_(file: RunFile = None, as_json: AsJson = False) -> None:
    """List the levels that runs can be given: those that ship, and those of a run file."""
    rows = [_row(name, levels) for name, levels in known_levels(file).items()]
    if as_json:
        say("", {"levels": rows}, as_json=True)
        return
    table = named_table(*COLUMNS)
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
    """A row as people read it; what the files of a distribution hold of speeds and the like differs by level."""
    size = f"{row['size'][0]}x{row['size'][1]}"
    if "files" in row:
        return [
            row["name"],
            row["rules"],
            f"<= {size}",
            f"<= {row['trains']}",
            *["as in files"] * 3,
            str(row["held_out"]),
        ]
    speeds = (
        "1" if row["speeds"] is None else ", ".join(f"{speed}: {part:.0%}" for speed, part in row["speeds"].items())
    )
    broken = row["malfunctions"]
    malfunctions = (
        "none" if broken is None else f"{broken['rate']:g}, {broken['min_steps']}-{broken['max_steps']} steps"
    )
    timetable = "yes" if row["timetable"] else "no"
    return [
        row["name"],
        row["rules"],
        size,
        str(row["trains"]),
        speeds,
        malfunctions,
        timetable,
        str(row["held_out"]),
    ]
