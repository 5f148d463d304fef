"""All observations: settings, compiled code. A new one is a module beside this, its test, and a line in each place."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Tag

from railctl.common.kernel import bare_kernel
from railctl.common.levels.distributions import Bounds, Rules
from railctl.common.rail.compiled.arrays import Batch
from railctl.common.rail.compiled.decisions import DECISIONS, Decisions
from railctl.common.rail.compiled.tree import Sight
from railctl.common.rail.observations.global_map import GlobalObservation, look_at_maps
from railctl.common.rail.observations.local_map import LocalObservation, look_around
from railctl.common.rail.observations.traffic import TrafficObservation, look_at_traffic
from railctl.common.rail.observations.tree import TreeObservation, look_at_trees
from railctl.common.strict import by_kind

AnyObservation = Annotated[
    Annotated[TreeObservation, Tag("tree")]
    | Annotated[GlobalObservation, Tag("global")]
    | Annotated[LocalObservation, Tag("local")]
    | Annotated[TrafficObservation, Tag("traffic")],
    by_kind("tree"),
]

TREE, GLOBAL, LOCAL, TRAFFIC = range(4)
NUMBERS = {"tree": TREE, "global": GLOBAL, "local": LOCAL, "traffic": TRAFFIC}


def header_of(observation: Any, rules: Rules, bounds: Bounds | None, decisions: Decisions) -> NDArray[np.int64]:
    """What `look` is told of one of `AnyObservation`: its number here, the rule of decisions, then its header."""
    fields = [NUMBERS[observation.kind], DECISIONS[decisions], *observation.header(rules, bounds)]
    return np.array(fields, np.int64)


@bare_kernel
def look(
    batch: Batch, sight: Sight, header: NDArray[np.int64], asking: NDArray[np.bool_], vectors: NDArray[np.float32]
) -> None:
    """The vectors [K, F] of the K trains that `asking` [E, N] marks, slot after slot; all must be visible."""
    vectors.reshape(vectors.size)[:] = 0
    if header[0] == TREE:
        look_at_trees(batch, sight, header[2:], asking, vectors)
    elif header[0] == GLOBAL:
        look_at_maps(batch, sight, header[2:], asking, vectors)
    elif header[0] == LOCAL:
        look_around(batch, sight, header[2:], asking, vectors)
    elif header[0] == TRAFFIC:
        look_at_traffic(batch, sight, int(header[1]), header[2:], asking, vectors)
