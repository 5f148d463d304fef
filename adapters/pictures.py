"""What `common.pictures` draws of a world."""

from railctl.common.pictures.glyphs import Sight
from railctl.common.rail.compiled.arrays import DONE, NOWHERE
from railctl.common.rail.compiled.world import CompiledWorld


def trains_of(world: CompiledWorld) -> list[Sight]:
    """The trains of a world's first slot."""
    batch = world.batch
    cells = batch.cells[0]
    seen = []
    for train in batch.trains[0, : batch.worlds[0]["trains"]]:
        waits = train["config"] == NOWHERE
        at = int(train["start"] if waits else train["config"])
        place = int(cells[at >> 2]["row"]), int(cells[at >> 2]["column"]), at & 3
        seen.append(Sight(None if train["state"] == DONE else place, bool(waits), bool(train["malfunction"] > 0)))
    return seen
