"""What a role may do from another machine; everything else is denied. Those of the run's own machine may do all."""

from dataclasses import dataclass
from typing import Any

from railctl.common.tls import FarRole
from railctl.common.wire import keys
from railctl.common.wire.keys import Service, Topic


@dataclass(frozen=True)
class Rights:
    """What a role may publish, hear, ask, and which tokens it may hold. None may answer questions."""

    publishes: tuple[Topic[Any], ...] = ()
    hears: tuple[Topic[Any], ...] = ()
    asks: tuple[Service[Any, Any], ...] = ()
    holds: tuple[str, ...] = ()


ACTOR = Rights(
    publishes=(keys.FRAGMENTS, keys.FAR_HEARTBEATS),
    hears=(keys.HEARTBEATS, keys.FAR_HEARTBEATS),  # its supervisor does: whether it lives, and the run goes on
    asks=(keys.RUN, keys.PULL_LEVELS, keys.LEASE, keys.PULL_WEIGHTS),
    holds=("alive/actor/*/*",),
)
READER = Rights(
    hears=(keys.EPISODE_ROWS, keys.EVALUATION_ROWS, keys.CHECKPOINTS, keys.HEARTBEATS, keys.FAR_HEARTBEATS),
    asks=(
        keys.RUN,
        keys.STATUS,
        keys.EPISODE_HISTORY,
        keys.EVALUATION_HISTORY,
        keys.LIST_CHECKPOINTS,
        keys.PULL_CHECKPOINT,
    ),
)
OPERATOR = Rights(hears=READER.hears, asks=(*READER.asks, keys.SCALE, keys.STOP, keys.COMMAND_LEARNER))

# A host sees of what comes through a relay only that: it may what those behind it may, and nobody may command there.
RELAY = Rights(
    publishes=ACTOR.publishes,
    hears=tuple(dict.fromkeys([*ACTOR.hears, *READER.hears])),
    asks=tuple(dict.fromkeys([*ACTOR.asks, *READER.asks])),
    holds=ACTOR.holds,
)

RIGHTS: dict[FarRole, Rights] = {"actor": ACTOR, "reader": READER, "operator": OPERATOR, "relay": RELAY}
BEHIND_A_RELAY: dict[FarRole, Rights] = {"actor": ACTOR, "reader": READER, "operator": READER}
