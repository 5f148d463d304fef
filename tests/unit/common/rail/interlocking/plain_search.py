"""Whether all trains can get home, by trying everything: one train at a time goes a cell further, the others stand."""

from collections.abc import Iterator

from railctl.common.rail.compiled.arrays import NOWHERE, SINGLE, UNREACHED, Batch

Places = tuple[int, ...]  # a configuration a train, NOWHERE once it is home


def everybody_gets_home(batch: Batch, places: Places, most: int = 200_000) -> bool:
    """Whether trains of slot 0 that rest at these places can all reach their targets, none ever in another's way.

    Raises:
        RuntimeError: that is not known after so many states.
    """
    seen, todo = {places}, [places]
    while todo:
        state = todo.pop()
        if all(place == NOWHERE for place in state):
            return True
        for other in following(batch, state):
            if other not in seen:
                seen.add(other)
                todo.append(other)
        if len(seen) > most:
            raise RuntimeError("too many states")
    return False


def following(batch: Batch, state: Places) -> Iterator[Places]:
    """The states that one train brings about; those nearest to its target come last."""
    codes, leads = batch.codes[0], batch.leads[0]
    taken = {place >> 2 for place in state if place != NOWHERE}
    steps = []
    for train, here in enumerate(state):
        if here == NOWHERE:
            continue
        distance = batch.distances[0, train]
        for way in range(4):
            if codes[here] >> way & 1 and (codes[here] & SINGLE or way != (here + 2) & 3):
                to = int(leads[(here & ~3) + way])
                if distance[to] < UNREACHED and to >> 2 not in taken:
                    place = NOWHERE if distance[to] == 0 else to
                    steps.append((-int(distance[to]), (*state[:train], place, *state[train + 1 :])))
    yield from (after for _, after in sorted(steps))
