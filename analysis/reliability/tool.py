"""How the original tool would be asked for the same: its classes and their parameters."""

from typing import Any

from railctl.analysis.reliability.curves import Curves
from railctl.analysis.reliability.measures import ALPHA
from railctl.analysis.reliability.switches import Switches
from railctl.analysis.reliability.zones import evaluation_points

TARGETS = {"SRT": "diffs", "LRT": "drawdown", "RR": "across"}
CLASSES = {"DT": "IqrWithinRuns", "DR": "IqrAcrossRuns", "MEDPERF": "MedianPerfDuringTraining"}


def tool_class(metric: str, switches: Switches) -> str:
    """Its name there."""
    if metric in CLASSES:
        return CLASSES[metric]
    return f"{_tail(metric, switches).capitalize()}CVaROn{TARGETS[metric].capitalize()}"


def tool_parameters(curves: Curves, metric: str, switches: Switches) -> dict[str, Any]:
    """Its attributes there."""
    baseline = None if switches.normalize == "none" else "curve_range"
    points = evaluation_points(curves, metric, switches)
    if metric in {"DT", "MEDPERF"}:
        within = metric == "DT" and switches.dt_detrend
        plain = {"window_size": curves.block - within, "eval_points": points, "baseline": baseline}
        return plain | ({"detrend": switches.dt_detrend} if metric == "DT" else {})
    filtered = switches.lowpass and points is not None
    common = {
        "baseline": baseline,
        "lowpass_thresh": 0.01 if filtered else None,
        "eval_points": points,
        "window_size": curves.block if filtered else None,
    }
    if metric == "DR":
        return common
    return {"target": TARGETS[metric], "tail": _tail(metric, switches), "alpha": ALPHA} | common


def _tail(metric: str, switches: Switches) -> str:
    return switches.drawdown_tail if metric == "LRT" else "lower"
