"""Asking the trains of one world in turn, from Python; `common.rail.interlocking.asking` says what is asked."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.compiled.arrays import DONE, NOTHING, NOWHERE, SINGLE, Batch
from railctl.common.rail.interlocking.asking import allowed, begin, grant, next_asked
from railctl.common.rail.interlocking.signals import ALL_ACTIONS, OFF, SAFE, Signals
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT


class Asking(Protocol):
    """A round of questions, one step's: iterate over it, and `grant` each train an action before the next is asked."""

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """The trains that decide, in the order in which they are asked, and the actions allowed them, a bit each."""
        ...

    def grant(self, train: int, action: int) -> None:
        """A train takes an action."""
        ...


class Interlocked:
    """An `Asking` of a slot of a batch."""

    def __init__(  # noqa: PLR0913
        self, batch: Batch, slot: int, mode: int, decisions: int, signals: Signals, deciding: NDArray[np.bool_]
    ) -> None:
        """`deciding` [N] are the trains to ask, by the rule of `decisions`."""
        self._told = batch, slot, mode
        self._signals, self._deciding = signals, deciding
        begin(*self._told, decisions, signals)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        batch, slot, _ = self._told
        while (train := next_asked(batch, slot, self._deciding, self._signals)) != NOTHING:
            yield train, allowed(*self._told, train, self._signals)

    def grant(self, train: int, action: int) -> None:
        grant(*self._told, train, action, self._signals)


class Free:
    """An `Asking` without an interlocking: everybody may do anything."""

    def __init__(self, deciding: NDArray[np.bool_]) -> None:
        """`deciding` [N] are the trains to ask."""
        self._trains: list[int] = np.flatnonzero(deciding).tolist()

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return ((train, ALL_ACTIONS) for train in self._trains)

    def grant(self, train: int, action: int) -> None:
        """Nobody hears of it."""


def asking_of(  # noqa: PLR0913
    batch: Batch, slot: int, mode: int, decisions: int, signals: Signals, deciding: NDArray[np.bool_]
) -> Asking:
    """A round of questions to the trains of a slot of which `deciding` [N] holds."""
    return Free(deciding) if mode == OFF else Interlocked(batch, slot, mode, decisions, signals, deciding)


@bare_kernel
def allowed_each(  # noqa: PLR0913
    batch: Batch, slot: int, mode: int, decisions: int, signals: Signals, bits: NDArray[np.uint8]
) -> None:
    """Fill `bits` [at least N] with what each train would be allowed if it were asked before all others.

    Those of trains that have arrived, or do not exist, stay as they are.
    """
    begin(batch, slot, mode, decisions, signals)
    for train in range(batch.worlds[slot]["trains"]):
        if batch.trains[slot, train]["state"] != DONE:
            bits[train] = allowed(batch, slot, mode, train, signals)


@bare_kernel
def unasked(codes: NDArray[np.int32], config: int, mode: int) -> int:
    """What a train is told that does not decide; `config` is NOWHERE off the map, which nobody leaves unasked.

    A train that broke down before it departed would otherwise come onto the map when it is repaired. Where rails only
    branch off to both sides, a slow one that is told to drive straight on before the end of the cell would stop for
    good; told to turn it runs on, and at the end it decides.
    """
    if mode < SAFE:
        return MOVE_FORWARD
    if config == NOWHERE:
        return DO_NOTHING
    if codes[config] & SINGLE or codes[config] >> (config & 3) & 1:
        return MOVE_FORWARD
    return MOVE_LEFT if codes[config] >> ((config + 3) & 3) & 1 else MOVE_RIGHT
