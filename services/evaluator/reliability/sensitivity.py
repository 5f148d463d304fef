"""How much the order of the algorithms hangs on what the text leaves open."""

from typing import Any, get_args

import numpy as np
from scipy.stats import rankdata

from services.evaluator.reliability.curves import Curves, Floats
from services.evaluator.reliability.document import plain
from services.evaluator.reliability.ranks import DECIMALS, mean_ranks, runs_ranked
from services.evaluator.reliability.switches import APPLY, Switches
from services.evaluator.reliability.zones import measured


@np.errstate(divide="ignore", invalid="ignore")  # runs without range
def sensitivity(curves: Curves) -> list[dict[str, Any]]:
    """Mean ranks over all levels, one switch moved at a time from its default, for each metric and zone.

    Rows {metric, zone, switch, value, mean_rank [A], order_changed}, those at defaults with switch and value None. Where
    ranks are undefined they are "nan", and whether the order changed is None.
    """
    rows = []
    for metric, names in APPLY.items():
        defaults = _mean_ranks(curves, metric, Switches())
        settings: list[tuple[str | None, Any]] = [(None, None)]
        settings += [(name, value) for name in names for value in _other_positions(name)]
        for switch, value in settings:
            changed = _mean_ranks(curves, metric, Switches() if switch is None else Switches(**{switch: value}))
            rows += [
                {
                    "metric": metric,
                    "zone": zone,
                    "switch": switch,
                    "value": value,
                    "mean_rank": plain(ranks),
                    "order_changed": _order_changed(defaults[zone], ranks),
                }
                for zone, ranks in changed.items()
            ]
    return rows


def _other_positions(switch: str) -> list[Any]:
    field = Switches.model_fields[switch]
    return [value for value in get_args(field.annotation) or (True, False) if value != field.default]


def _mean_ranks(curves: Curves, metric: str, switches: Switches) -> dict[str, Floats]:
    found = measured(curves, metric, switches)
    return {zone: mean_ranks(worse) / runs_ranked(worse) for zone, worse in found.worse.items()}


def _order_changed(before: Floats, after: Floats) -> bool | None:
    if np.isnan([before, after]).any():
        return None
    return bool((_order(before) != _order(after)).any())


def _order(ranks: Floats) -> Floats:
    return np.asarray(rankdata(np.round(ranks, DECIMALS)))
