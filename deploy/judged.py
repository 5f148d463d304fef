"""What `analysis.reliability` found, for people."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table

TITLES = {
    "DT": "DT, dispersion across time: how far returns jump from episode to episode",
    "DR": "DR, dispersion across runs: how far runs lie apart",
    "SRT": "SRT, short-term risk: the worst steps from one block to the next",
    "LRT": "LRT, long-term risk: the deepest falls from the best so far",
}
CAPTION = (
    "score: 1 + algorithms - mean rank over levels, so more is better; low, high: its 95% interval (bootstrap)\n"
    "differs from: permutation tests after Benjamini and Yekutieli at 0.05; in brackets by the original tool's rule"
)


def judged_parts(document: Mapping[str, Any]) -> Iterator[Table | str]:
    """A title and a table a metric, and what may change the order of the algorithms."""
    for key, title in TITLES.items():
        yield title
        table = Table(box=None, pad_edge=False)
        for name in ("episodes", "#", "algorithm", "score", "low", "high", "differs from"):
            table.add_column(name, justify="right" if name in {"score", "low", "high"} else "left", no_wrap=True)
        for zone in document["metrics"][key]["stats"]["all"].values():
            for row in _rows(zone, document):
                table.add_row(*row)
        yield table
        changes = _changes([row for row in document["sensitivity"] if row["metric"] == key])
        yield f"the order at the defaults changes with {changes or 'no switch'}\n"
    yield CAPTION


def _rows(zone: Mapping[str, Any], document: Mapping[str, Any]) -> Iterator[list[str]]:
    names = document["algorithms"]
    when = _episodes(zone["eval_idx"], document["shape"]["block"])
    for index, name in enumerate(names):
        said = [when if index == 0 else "", str(index + 1), name]
        if "bar_height" not in zone:
            yield [*said, "-", "-", "-", "undefined: values are not finite" if index == 0 else ""]
            continue
        ends = (len(names) + 1 - rank if isinstance(rank, float) else None for rank in reversed(zone["ci95"][index]))
        figures = ["-" if figure is None else f"{figure:.2f}" for figure in (zone["bar_height"][index], *ends)]
        yield [*said, *figures, _differs(index, zone["significant"])]


def _differs(index: int, significant: Mapping[str, Sequence[Sequence[int]]]) -> str:
    """The numbers of those that an algorithm makes a pair with.

    >>> _differs(1, {"textbook_by_0.05": [[0, 1], [0, 2], [1, 3]], "by_0.01": [[1, 3]]})
    '1 4 (4)'
    """
    textbook, tool = (
        " ".join(str(sum(pair) - index + 1) for pair in significant[rule] if index in pair)
        for rule in ("textbook_by_0.05", "by_0.01")
    )
    return f"{textbook or '-'} ({tool or '-'})" if textbook or tool else ""


def _episodes(points: Sequence[int] | None, block: int) -> str:
    """Where a zone lies.

    >>> _episodes([5, 6, 7], 100)
    '501-800'
    """
    return f"{points[0] * block + 1}-{(points[-1] + 1) * block}" if points else "all"


def _changes(rows: Sequence[Mapping[str, Any]]) -> str:
    """The switches that change the order in some zone."""
    changing = [f"{row['switch']}={str(row['value']).lower()}" for row in rows if row["order_changed"]]
    return ", ".join(dict.fromkeys(changing))
