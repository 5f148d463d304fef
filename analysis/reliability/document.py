"""All that is said of curves, as one document of plain data; `docs/reliability.md` describes it."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from railctl.analysis.reliability.curves import Curves, Floats
from railctl.analysis.reliability.draws import Draws, KeyedDraws, ToolDraws
from railctl.analysis.reliability.measures import METRICS
from railctl.analysis.reliability.ranks import mean_ranks, pooled_ranks, runs_ranked
from railctl.analysis.reliability.resampling import pairs_of
from railctl.analysis.reliability.samples import CurveSamples, RunSamples, Samples
from railctl.analysis.reliability.significance import Rule, differing
from railctl.analysis.reliability.switches import MAIN, RECORDS, Switches
from railctl.analysis.reliability.tool import tool_class, tool_parameters
from railctl.analysis.reliability.zones import measured

INTERVAL = (2.5, 97.5)
TOLERANCE = 1e-9  # of differences of mean ranks: equal ones may be a rounding error apart
WITH_RANKS = ("DT", "SRT")
UNDEFINED = "values that are not finite, or none; ranks undefined"
PERCENTILES = {"p2.5": 2.5, "p5": 5, "p95": 95, "p97.5": 97.5}
RULES: dict[str, tuple[Rule, float]] = {
    "by_0.05": ("tool", 0.05),
    "by_0.01": ("tool", 0.01),
    "bonf_0.05": ("bonferroni", 0.05),
    "raw_0.05": ("none", 0.05),
    "textbook_by_0.05": ("textbook", 0.05),
}


@np.errstate(divide="ignore", invalid="ignore")  # runs without range
def judge(  # noqa: PLR0913  (what is judged, and how)
    curves: Curves,
    *,
    protocol: Literal["default", "tool"] = "default",
    bootstraps: int = 1000,
    permutations: int = 10_000,
    keys: Sequence[str] | None = None,
    switches: Switches | None = None,
    tell: Callable[[int, int], None] = lambda _done, _total: None,
) -> dict[str, Any]:
    """Values, ranks, intervals and comparisons: the records named (keys of `RECORDS`), by default all.

    Records start from `switches` and set their own. Protocol "tool" draws exactly as the original does, which has 1000
    bootstraps and 1000 permutations. `tell` hears how many records are done, and of how many.
    """
    runs = curves.returns.shape[2]
    draws = ToolDraws(runs) if protocol == "tool" else KeyedDraws(runs, bootstraps, permutations)
    names = list(RECORDS) if keys is None else list(keys)
    metrics = {}
    for done, key in enumerate(names):
        tell(done, len(names))
        metrics[key] = _record(curves, key, switches or Switches(), draws)
    tell(len(names), len(names))
    return {
        "shape": _shape(curves),
        "algorithms": list(curves.algorithms),
        "levels": list(curves.levels),
        "protocol": protocol,
        "n_resamples": draws.bootstraps,
        "n_permutations": draws.permutations,
        "training_curve": _training_curve(curves),
        "metrics": metrics,
    }


def plain(values: NDArray[Any]) -> Any:
    """An array as lists of numbers, those that are not finite as "nan", "inf" and "-inf"."""
    if np.isfinite(values).all():
        return values.tolist()
    return [plain(value) for value in values] if values.ndim else str(float(values))


def _record(curves: Curves, key: str, given: Switches, draws: Draws) -> dict[str, Any]:
    name, own, resampled = RECORDS[key]
    switches = given.model_copy(update=dict(own))
    found = measured(curves, name, switches)
    samples: Samples | None = None
    if resampled:
        samples = CurveSamples(curves, found.zones, switches, draws) if name == "DR" else RunSamples(draws)
    every = list(range(len(curves.levels)))
    scopes = {"all": every} | ({f"task{level}": [level] for level in every} if key in MAIN else {})
    stats: dict[str, dict[str, Any]] = {}
    for scope, levels in scopes.items():
        stats[scope] = {}
        for zone, points in found.zones.items():
            worse = found.worse[zone][:, levels]
            stats[scope][zone] = {"eval_idx": points} | _ranking(worse)
            if samples is not None and np.isfinite(worse).all():
                stats[scope][zone] |= _comparison(worse, samples, zone, levels, draws)
            if key in WITH_RANKS and scope == "all":
                stats[scope][zone]["ranks"] = plain(pooled_ranks(worse))
    return {
        "tool_class": tool_class(name, switches),
        "params": tool_parameters(curves, name, switches),
        "switches": switches.model_dump(),
        "dims": METRICS[name].axes,
        "bigger_is_better": METRICS[name].bigger_is_better,
        "values": plain(found.values),
        "stats": stats,
    }


def _ranking(worse: Floats) -> dict[str, Any]:
    ranks = mean_ranks(worse) / runs_ranked(worse)
    if np.isnan(ranks).any():
        return {"note": UNDEFINED, "mean_rank": plain(ranks)}
    return {"mean_rank": plain(ranks), "bar_height": plain(len(ranks) + 1 - ranks)}


def _comparison(worse: Floats, samples: Samples, zone: str, levels: list[int], draws: Draws) -> dict[str, Any]:
    """Intervals of mean ranks, p-values of their differences, and which of these are significant."""
    runs, ranks, pairs = runs_ranked(worse), mean_ranks(worse), pairs_of(len(worse))
    ends = np.percentile(samples.bootstrapped(worse, zone, levels), INTERVAL, axis=1).T / runs
    differences = np.array([ranks[two] - ranks[one] for one, two in pairs])
    permuted, observed = np.abs(samples.permuted(worse, zone, levels)), np.abs(differences)[:, None]
    p_tool = (permuted >= observed).mean(-1)
    as_far = (permuted >= observed - TOLERANCE).sum(-1)
    p_tol = (as_far + draws.observed) / (draws.permutations + draws.observed)
    columns = zip(pairs, p_tool.tolist(), p_tol.tolist(), (differences / runs).tolist(), strict=True)
    significant = {
        name: [list(pairs[index]) for index in differing(p_tol if rule == "textbook" else p_tool, alpha, rule)]
        for name, (rule, alpha) in RULES.items()
    }
    return {"ci95": plain(ends), "pairs": [[*pair, *row] for pair, *row in columns], "significant": significant}


def _shape(curves: Curves) -> dict[str, int]:
    algorithms, levels, runs, episodes = curves.returns.shape
    return {
        "algorithms": algorithms,
        "tasks": levels,
        "runs": runs,
        "episodes": episodes,
        "block": curves.block,
        "eval_points": curves.points,
        "zones": curves.zones,
    }


def _training_curve(curves: Curves) -> dict[str, Any]:
    """What all runs of an algorithm and level reach, [A, K, P] each."""
    means = curves.means
    centres = (np.arange(curves.points) + 0.5) * curves.block
    statistics = {"mean": means.mean(2), "median": np.median(means, axis=2)}
    statistics |= {name: np.percentile(means, share, axis=2) for name, share in PERCENTILES.items()}
    return {"episode_at_window_centre": plain(centres)} | {name: plain(of) for name, of in statistics.items()}
