"""How much the order of the algorithms hangs on what the text leaves open."""

from typing import Any, get_args

import numpy as np
from scipy.stats import rankdata

from railctl.analysis.reliability.curves import Curves, Floats
from railctl.analysis.reliability.document import plain
from railctl.analysis.reliability.ranks import DECIMALS, mean_ranks, runs_ranked
from railctl.analysis.reliability.switches import APPLY, Switches
from railctl.analysis.reliability.zones import measured


@np.errstate(divide="ignore", invalid="ignore")  # runs without range
def sensitivity(curves: Curves) -> list[dict[str, Any]]:
    """Mean ranks over all levels, for each metric, each position of each switch (all others at their default) and zone.

    Rows {metric, switch, value, zone, mean_rank [A], order_changed}; the order is compared with that of the defaults.
    Where ranks are undefined they are "nan", and whether the order changed is None.
    """
    rows = []
    for metric, names in APPLY.items():
        defaults = _mean_ranks(curves, metric, Switches())
        for switch, value in ((name, value) for name in names for value in _positions(name)):
            ranks = _mean_ranks(curves, metric, Switches.model_validate({switch: value}))
            rows += [
                {
                    "metric": metric,
                    "switch": switch,
                    "value": value,
                    "zone": zone,
                    "mean_rank": plain(ranks[zone]),
                    "order_changed": _order_changed(defaults[zone], ranks[zone]),
                }
                for zone in defaults
            ]
    return rows


def _positions(switch: str) -> tuple[str | bool, ...]:
    return get_args(Switches.model_fields[switch].annotation) or (True, False)


def _mean_ranks(curves: Curves, metric: str, switches: Switches) -> dict[str, Floats]:
    found = measured(curves, metric, switches)
    return {zone: mean_ranks(worse) / runs_ranked(worse) for zone, worse in found.worse.items()}


def _order_changed(before: Floats, after: Floats) -> bool | None:
    if np.isnan([before, after]).any():
        return None
    return bool((_order(before) != _order(after)).any())


def _order(ranks: Floats) -> Floats:
    return np.asarray(rankdata(np.round(ranks, DECIMALS)))
