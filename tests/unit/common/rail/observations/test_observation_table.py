"""All observations have sizes and headers, and are told apart by their kind."""

import pytest
from pydantic import TypeAdapter, ValidationError

from railctl.common.levels.distributions import Bounds
from railctl.common.rail.observations.global_map import GlobalObservation
from railctl.common.rail.observations.local_map import LocalObservation
from railctl.common.rail.observations.table import AnyObservation, header_of
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.tree import TreeObservation

BOUNDS = Bounds(30, 40, 9)


@pytest.mark.parametrize(
    ("observation", "size", "low", "high"),
    [
        (TreeObservation(), 252, -1, 0),
        (TreeObservation(depth=1), 60, -1, 0),
        (TreeObservation(depth=3, features="plain"), 1020, -1, 0),
        (GlobalObservation(), 30 * 40 * 23, 0, 1),
        (LocalObservation(), 11 * 11 * 23, 0, 1),
        (TrafficObservation(), 61 + 6 * 55, -1, 1),
        (TrafficObservation(others=1), 61 + 55, -1, 1),
    ],
)
def test_sizes_and_ranges(observation: AnyObservation, size: int, low: float, high: float):
    assert (observation.n_features(BOUNDS), observation.low, observation.high) == (size, low, high)


def test_headers():
    plain, repaired = TreeObservation(features="plain", depth=1), TreeObservation(conflicts="repaired")
    assert header_of(TreeObservation(), "legacy", None, "always").tolist() == [0, 0, 1, 2, 0, 100]
    assert header_of(plain, "stock", BOUNDS, "legacy").tolist() == [0, 1, 0, 1, 1, 140]
    assert header_of(repaired, "stock", None, "cells").tolist() == [0, 2, 2, 2, 0, 100]
    assert header_of(repaired, "legacy", None, "cells").tolist() == [0, 2, 1, 2, 0, 100]
    assert header_of(GlobalObservation(), "legacy", BOUNDS, "cells").tolist() == [1, 2, 1, 30, 40]
    assert header_of(LocalObservation(radius=4), "stock", None, "cells").tolist() == [2, 2, 0, 4]
    assert header_of(TrafficObservation(others=4), "stock", None, "cells").tolist() == [3, 2, 4, 3]


def test_the_table_knows_every_kind():
    adapter: TypeAdapter[AnyObservation] = TypeAdapter(AnyObservation)
    for kind in ("tree", "global", "local", "traffic"):
        assert adapter.validate_python({"kind": kind}).kind == kind
    wrong = (
        {"kind": "none"},
        {"kind": "tree", "depth": 4},
        {"kind": "local", "radius": 0},
        {"kind": "global", "depth": 2},
        {"kind": "traffic", "others": 33},
    )
    for data in wrong:
        with pytest.raises(ValidationError):
            adapter.validate_python(data)


def test_what_older_runs_call_their_features():
    assert TreeObservation.model_validate({"features": "study"}) == TreeObservation(features="detour")
