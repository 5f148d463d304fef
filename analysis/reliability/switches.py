"""What the study's text leaves open about the metrics, as switches; and the records that are made of them."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from railctl.common.strict import ConfigError, Strict, describe, nearest


class Switches(Strict):
    """The defaults are the metrics as `docs/reliability.md` defines them."""

    normalize: Literal["none", "curve_range", "curve_range_block"] = "none"  # by a run's range: of episodes, of blocks
    risk_curve: Literal["eval_points", "moving_average", "episodes"] = "eval_points"  # whose risk SRT and LRT are
    dt_detrend: bool = True  # the spread of differences, not of returns
    zone_collapse: Literal["median", "mean"] = "median"  # of a zone's points
    drawdown_tail: Literal["upper", "lower"] = "upper"
    zones: Literal["index", "tool"] = "index"  # equal parts; or as the original cuts points that do not start at 0
    dr_center: bool = False  # before runs are permuted, every algorithm's mean curve is taken off
    lowpass: bool = False  # DR and RR look at filtered episodes, as the original's sample configuration does


class Record(NamedTuple):
    """One entry of the document: a metric under switches of its own."""

    metric: Literal["DT", "DR", "SRT", "LRT", "RR", "MEDPERF"]
    own: Mapping[str, Any] = {}
    resampled: bool = True


_TOOL_ACROSS = {"normalize": "curve_range", "zones": "tool", "lowpass": True}
_TOOL_RISK = {"normalize": "curve_range", "risk_curve": "episodes"}

RECORDS = {
    "DT": Record("DT"),
    "DR": Record("DR"),
    "SRT": Record("SRT"),
    "LRT": Record("LRT"),
    "LRT_lower": Record("LRT", {"drawdown_tail": "lower"}),
    "RR": Record("RR", resampled=False),
    "MEDPERF": Record("MEDPERF", resampled=False),
    "DT_cr": Record("DT", {"normalize": "curve_range"}),
    "DR_cr": Record("DR", {"normalize": "curve_range_block"}),
    "SRT_cr": Record("SRT", {"normalize": "curve_range_block"}),
    "LRT_cr": Record("LRT", {"normalize": "curve_range_block"}),
    "SRT_ep": Record("SRT", {"risk_curve": "episodes"}),
    "LRT_ep": Record("LRT", {"risk_curve": "episodes"}),
    "SRT_ma": Record("SRT", {"risk_curve": "moving_average"}),
    "LRT_ma": Record("LRT", {"risk_curve": "moving_average"}),
    "tool_DT": Record("DT", {"normalize": "curve_range", "zones": "tool"}),
    "tool_DR": Record("DR", _TOOL_ACROSS, resampled=False),
    "tool_RR": Record("RR", _TOOL_ACROSS, resampled=False),
    "tool_SRT": Record("SRT", _TOOL_RISK),
    "tool_LRT": Record("LRT", _TOOL_RISK | {"drawdown_tail": "lower"}),
}
MAIN = ("DT", "DR", "SRT", "LRT")  # those of the study, which are judged on every level, too

APPLY = {  # to what a switch makes a difference
    "DT": ("normalize", "dt_detrend", "zone_collapse", "zones"),
    "DR": ("normalize", "zone_collapse", "zones", "dr_center", "lowpass"),
    "SRT": ("normalize", "risk_curve"),
    "LRT": ("normalize", "risk_curve", "drawdown_tail"),
}


def parse_switches(settings: Mapping[str, Any]) -> Switches:
    """Check switches from outside.

    Raises:
        ConfigError: there is no such switch, or it has no such position.
    """
    known = list(Switches.model_fields)
    for name in settings:
        if name not in known:
            raise ConfigError(f"unknown switch {name}{nearest(name, known)}")
    try:
        return Switches.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(f"switch {describe(error, Switches)}") from None
