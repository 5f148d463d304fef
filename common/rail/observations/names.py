"""What the numbers of an observation mean, in words, for people; the modules of the kernels say more."""

from collections.abc import Iterator
from typing import Any

from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.tree import TreeObservation

NODE = (
    "own target",
    "another's target",
    "another train",
    "conflict",
    "unusable switch",
    "next branch",
    "distance or detour to the target",
    "trains of the same direction",
    "trains of opposite direction",
    "malfunction left",
    "slowest speed",
    "trains ready to depart",
)
BRANCHES = ("left", "forward", "right", "back")
TRAIN = (
    "is on the map",
    "distance to the target",
    "time",
    "trains on the map",
    "trains not arrived",
    "rank by distance",
    "steps to spare before the step limit",
    "steps to spare before the latest arrival",
    "ways of others through its cell",
    "patience",
    "stands",
    "malfunction left",
    "full speed",
)
EXIT = (
    "is there",
    "would be granted",
    "leads to the target",
    "way from there",
    "detour",
    "is on a shortest way",
    "a train is in the next cell",
    "the next cell is the target",
    "way to the next decision",
    "no more decisions",
    "first train on the way",
    "first oncoming train",
    "oncoming trains",
    "longest malfunction on the way",
    "conflicts with trains not listed",
    "earliest of these conflicts",
)
OTHER = (
    "is there",
    "is on the map",
    "stands",
    "has a lower number",
    "distance to its target",
    "malfunction left",
    "full speed",
    "patience",
    "nearness",
    "this train on its way",
)
MEETING = (
    "shared stretch",
    "begin of the stretch",
    "length of the stretch",
    "its nearness to the stretch",
    "margin if this train goes first",
    "margin if the other goes first",
    "where this train could wait",
    "where the other could wait",
    "the other is in the stretch",
    "this train is in the stretch",
    "first crossing",
    "first merging",
    "how much earlier the other is there",
    "the other on this train's way",
    "how much longer its way is",
)
EXITS = ("left", "forward", "right")

Groups = Iterator[tuple[str, tuple[str, ...]]]


def groups_of(observation: Any) -> list[tuple[str, tuple[str, ...]]]:
    """What all F numbers of one of `AnyObservation` mean, by groups in their order; nothing for maps."""
    if isinstance(observation, TreeObservation):
        return list(_nodes("root", "", observation.depth))
    if isinstance(observation, TrafficObservation):
        return list(_traffic(observation.others))
    return []


def _nodes(name: str, path: str, depth: int) -> Groups:
    yield name, NODE
    if depth:
        for branch in BRANCHES:
            below = f"{path}, {branch}" if path else branch
            yield from _nodes(below, below, depth - 1)


def _traffic(others: int) -> Groups:
    yield "this train", TRAIN
    for way in EXITS:
        yield f"exit {way}", EXIT
    for other in range(1, others + 1):
        yield f"other train {other}", OTHER
        for way in EXITS:
            yield f"other train {other}, behind exit {way}", MEETING
