"""What was run, what is missing, how long it took, and on what."""

import platform
from collections import Counter
from collections.abc import Iterator
from datetime import timedelta
from importlib.metadata import version

from railctl.analysis.report.parts import Listing, Section
from railctl.analysis.report.results import Results, State, Trained
from railctl.analysis.report.tables import Cell, Column, Table

PACKAGES = ("railctl", "flatland-rl", "torch", "numpy", "scipy", "matplotlib")
STATES: tuple[State, ...] = ("done", "unfinished", "failed", "missing")


def summary(results: Results) -> Section:
    """The first thing to read."""
    return Section(
        "Summary", (_what(results), Listing(tuple(_lines(results))), _runs(results), Listing(tuple(_by(results))))
    )


def _what(results: Results) -> str:
    return (
        f"{many(len(results.runs))} of {', '.join(results.contenders)} on {', '.join(results.levels)}, with seeds "
        f"{', '.join(map(str, results.seeds))}. Returns are normalised: the sum of all rewards over trains times step "
        f"limit, -1 at worst. Curves are compared over {results.episodes} episodes, in {results.points} evaluation "
        f"points of {results.judgement.block}. Final scores are those of {results.scored_by}."
    )


def _lines(results: Results) -> Iterator[str]:
    """What is done, what is not, and what it took."""
    states = Counter(trained.state for trained in results.runs.values())
    yield "Runs: " + ", ".join(f"{states[state]} {state}" for state in STATES if states[state] or state == "done") + "."
    for state in ("unfinished", "missing"):
        names = [run.name for run, trained in results.runs.items() if trained.state == state]
        if names:
            yield f"{state.capitalize()}: {', '.join(names)}."
    for run, trained in results.runs.items():
        if trained.state == "failed":
            yield f"Failed: {run.name}: {trained.reason or 'no reason was left'}."
    yield from _not_repeatable(results)
    unscored = [run.name for run, trained in results.runs.items() if trained.state == "done" and trained.scored is None]
    if unscored:
        yield f"Done, but without a final score: {', '.join(unscored)}."
    references = [f"{policy} on {level}" for (policy, level), found in results.references.items() if found is None]
    if references:
        yield f"Reference policies without a score: {', '.join(references)}."
    times = {trained.unix_s for trained in results.runs.values() if trained.unix_s}
    if times:
        span = max(end for _, end in times) - min(begun for begun, _ in times)
        total = sum(end - begun for begun, end in times)
        yield f"Time: {_duration(span)} from the first episode to the last; {_duration(total)} if runs are added up."


def _not_repeatable(results: Results) -> Iterator[str]:
    """Which runs nobody can make again, and how old the weights were that acted them."""
    for run, trained in results.runs.items():
        if trained.config is not None and trained.is_free:
            mean = "-" if trained.staleness is None else f"{trained.staleness:.1f}"
            most = trained.config.max_staleness
            stale = f"staleness mean {mean}, at most {most}"
            yield f"{run.name} is not repeatable: acted with the newest weights ({stale})."


def many(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"


def _duration(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


def _runs(results: Results) -> Table:
    rows: list[list[Cell]] = [
        [level, contender, *_counts(cell)]
        for level in results.levels
        for contender in results.contenders
        if (cell := results.cell(contender, level))
    ]
    columns = ("level", "contender", "runs", *STATES, "episodes", "scored")
    caption = "How runs stand, how many episodes they have trained together, and how many have a final score."
    return Table("table-runs", "Runs", caption, tuple(map(Column, columns)), rows)


def _counts(cell: list[Trained]) -> list[int]:
    states = Counter(trained.state for trained in cell)
    episodes = sum(len(trained.returns) for trained in cell)
    scored = sum(trained.scored is not None for trained in cell)
    return [len(cell), *(states[state] for state in STATES), episodes, scored]


def _by(results: Results) -> Iterator[str]:
    """What runs were computed with, and this report."""
    computers = Counter(trained.arithmetic for trained in results.runs.values() if trained.arithmetic)
    for arithmetic, count in sorted(computers.items()):
        yield f"Computed with {', '.join(f'{key} {value}' for key, value in arithmetic)}: {many(count)}."
    packages = ", ".join(f"{package} {version(package)}" for package in PACKAGES)
    yield f"This report: {packages}, Python {platform.python_version()}."
