"""Which trains must decide: three rules, over the tables of a batch.

| mode | a train decides when it is ready to depart, or when it is on the map, not committed, and ... |
|---|---|
| ALWAYS | at the end of a cell: flatland-rl 4.3.0's `action_required` |
| LEGACY | (nothing more): that of 2.2.2 |
| CELLS | at the end of a cell, not broken down, and where `common.rail.decisions` says so |
"""

from typing import Final

from common.rail.compiled.arrays import (
    BROKEN,
    DECIDES,
    MOVING,
    NOTHING,
    READY,
    STOPPED,
    Batch,
)
from common.rail.compiled.kernel import kernel

ALWAYS: Final = 0
LEGACY: Final = 1
CELLS: Final = 2


@kernel
def decides(batch: Batch, slot: int, at: int, mode: int) -> bool:
    """Whether the train `at` of a slot must decide."""
    train = batch.trains[slot, at]
    if train["state"] == READY:
        return True
    if train["state"] not in (MOVING, STOPPED, BROKEN) or train["committed"] != NOTHING:
        return False
    if mode == LEGACY:
        return True
    ends = bool(train["distance"] + train["full_speed"] >= batch.worlds[slot]["unit"])
    if mode == ALWAYS:
        return ends
    return ends and train["malfunction"] == 0 and batch.codes[slot, train["config"]] & DECIDES != 0
