"""All observations have sizes and headers, and are told apart by their kind."""

import pytest
from pydantic import TypeAdapter, ValidationError

from common.levels.distributions import Bounds
from common.rail.observations.global_map import GlobalObservation
from common.rail.observations.local_map import LocalObservation
from common.rail.observations.table import AnyObservation, header_of
from common.rail.observations.tree import TreeObservation

BOUNDS = Bounds(30, 40, 9)


@pytest.mark.parametrize(
    ("observation", "size", "low", "high"),
    [
        (TreeObservation(), 252, -1, 0),
        (TreeObservation(depth=1), 60, -1, 0),
        (TreeObservation(depth=3, features="plain"), 1020, -1, 0),
        (GlobalObservation(), 30 * 40 * 23, 0, 1),
        (LocalObservation(), 11 * 11 * 23, 0, 1),
    ],
)
def test_sizes_and_ranges(observation: AnyObservation, size: int, low: float, high: float):
    assert (observation.n_features(BOUNDS), observation.low, observation.high) == (size, low, high)


def test_headers():
    assert header_of(TreeObservation(), "legacy", None).tolist() == [0, 1, 2, 0, 100]
    assert header_of(TreeObservation(features="plain", depth=1), "stock", BOUNDS).tolist() == [0, 0, 1, 1, 140]
    assert header_of(TreeObservation(conflicts="repaired"), "stock", None).tolist() == [0, 2, 2, 0, 100]
    assert header_of(TreeObservation(conflicts="repaired"), "legacy", None).tolist() == [0, 1, 2, 0, 100]
    assert header_of(GlobalObservation(), "legacy", BOUNDS).tolist() == [1, 1, 30, 40]
    assert header_of(LocalObservation(radius=4), "stock", None).tolist() == [2, 0, 4]


def test_the_table_knows_every_kind():
    adapter: TypeAdapter[AnyObservation] = TypeAdapter(AnyObservation)
    for kind in ("tree", "global", "local"):
        assert adapter.validate_python({"kind": kind}).kind == kind
    wrong = (
        {"kind": "none"},
        {"kind": "tree", "depth": 4},
        {"kind": "local", "radius": 0},
        {"kind": "global", "depth": 2},
    )
    for data in wrong:
        with pytest.raises(ValidationError):
            adapter.validate_python(data)
