"""The ledger: which episode, or which fragment of one, is waiting, leased, received or trained.

Pure: no clock, no bus, no disk. Episode e acts with the weights after episode e - 1 - lag, so it may be leased once
e - lag episodes are trained. With lag 0 an episode may come in fragments: each acts with the weights after the one
before. `free_ledger` has other versions. Training is strictly in order. Leases belong to living actors only; what a
dead actor had leased waits again.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from railctl.common.levels.distributions import ANY
from railctl.common.records.acting import MOST_KEPT, Fragment

Unit = tuple[int, int]  # episode, fragment


class Ledger:
    """The account of the episodes 0..N-1 of a run."""

    def __init__(self, levels: Sequence[str], lag: int, trained: int = 0, fragment: int = 0, version: int = 0) -> None:
        self.levels = levels  # the name of each episode's distribution
        self._lag = lag
        self.trained = trained  # episodes below this number are trained
        self.fragment = fragment  # of episode `trained`: those below are trained
        self.version = version  # of the weights: how many fragments were ever trained
        self._leases: dict[Unit, str] = {}  # to the incarnation of an actor
        self._received: dict[Unit, Fragment] = {}
        self._brought_by: dict[Unit, str | None] = {}
        self._alive: set[str] = set()
        self._holder: str | None = None  # the actor whose world probably stands where the open episode goes on
        self.duplicates = 0
        self.reissued = 0

    @property
    def total(self) -> int:
        return len(self.levels)

    @property
    def finished(self) -> bool:
        return self.trained == self.total

    @property
    def leased(self) -> int:
        return len(self._leases)

    def lessee(self, unit: Unit) -> str | None:
        """The incarnation that holds the lease of a unit."""
        return self._leases.get(unit)

    def weights_version(self, episode: int) -> int:
        """The version of the weights that an episode, or the open episode's next fragment, acts with."""
        return self._version_after(max(0, episode - self._lag))

    def versions(self, episode: int) -> range:
        """The versions that an episode may have been acted with."""
        version = self.weights_version(episode)
        return range(version, version + 1)

    def waiting(self) -> dict[str, int]:
        """How many episodes of each distribution could be acted now but are not."""
        counts: dict[str, int] = {}
        for episode, _ in self._to_lease():
            counts[self.levels[episode]] = counts.get(self.levels[episode], 0) + 1
        return counts

    def actor_came(self, incarnation: str) -> None:
        """An actor lives; only now can it hold leases."""
        self._alive.add(incarnation)

    def actor_gone(self, incarnation: str) -> None:
        """An actor died: what it had leased waits again."""
        self._alive.discard(incarnation)
        self._release(incarnation, keep=set())

    def missing(self, incarnation: str, kept: Iterable[Unit]) -> list[Unit]:
        """Of what a living actor keeps, that which the learner lacks and nobody else acts; it counts as leased to it.

        An actor asks only when it acts nothing, so leases of its that it does not keep never reached it, and end.
        Where much waits for its turn already, no more is taken than there is room for, and the rest is acted anew.
        """
        lacking = [
            unit
            for unit in sorted(set(kept))
            if self.is_to_come(unit) and self._leases.get(unit, incarnation) == incarnation
        ]
        lacking = lacking[: max(0, MOST_KEPT - len(self._received))] if incarnation in self._alive else []
        self._release(incarnation, keep=set(lacking))
        self._leases.update(dict.fromkeys(lacking, incarnation))
        return lacking

    def grant(self, incarnation: str, serves: str) -> Unit | None:
        """Lease what waits first of a served distribution to a living actor; None if there is nothing.

        An open episode goes on where its world already stands, as long as that actor lives.
        """
        if incarnation not in self._alive:
            return None
        for unit in self._to_lease():
            elsewhere = unit[1] > 0 and self._holder in self._alive and self._holder != incarnation
            if serves in (ANY, self.levels[unit[0]]) and not elsewhere:
                self._leases[unit] = incarnation
                return unit
        return None

    def is_to_come(self, unit: Unit) -> bool:
        """A unit of this run that is neither trained nor here."""
        return (self.trained, self.fragment) <= unit < (self.total, 0) and unit not in self._received

    def receive(self, fragment: Fragment) -> bool:
        """Take an episode or fragment in; False for one that is not to come."""
        unit = fragment.lease.unit
        if not self.is_to_come(unit):
            self.duplicates += 1
            return False
        self._brought_by[unit] = self._leases.pop(unit, None)
        self._received[unit] = fragment
        return True

    def next_ready(self) -> Fragment | None:
        """What is to be trained now, if it is here."""
        return self._received.get((self.trained, self.fragment))

    def discard(self) -> str | None:
        """What `next_ready` named is not as it must be and waits again; returns the incarnation that brought it."""
        unit = (self.trained, self.fragment)
        del self._received[unit]
        return self._brought_by.pop(unit)

    def held(self) -> dict[Unit, str]:
        """What only one actor may act now: it has the lease, or its world stands where the open episode goes on."""
        held = dict(self._leases)
        if self.fragment and self._holder in self._alive and self.next_ready() is None:
            held.setdefault((self.trained, self.fragment), self._holder)
        return held

    def take_back(self, unit: Unit) -> None:
        """What was held waits again, for anyone."""
        if unit in self._leases:
            self.end_lease(unit)
        if unit == (self.trained, self.fragment):
            self._holder = None

    def end_lease(self, unit: Unit) -> None:
        """A leased unit waits again."""
        del self._leases[unit]
        self.reissued += 1

    def mark_trained(self) -> None:
        """What `next_ready` named is trained."""
        unit = (self.trained, self.fragment)
        fragment, self._holder = self._received.pop(unit), self._brought_by.pop(unit)
        self.version += 1
        if fragment.course.over:
            self.trained += 1
            self.fragment = 0
        else:
            self.fragment += 1
        for of_units in (self._leases, self._received, self._brought_by):
            drop_before((self.trained, self.fragment), of_units)

    def _version_after(self, episodes: int) -> int:
        """The version of the weights after so many episodes, as long as these have no fragments."""
        return self.version - self.trained + episodes

    def _to_lease(self) -> list[Unit]:
        """What may be acted now, and nobody does."""
        last = min(self.trained + self._lag, self.total - 1)
        units = [(e, self.fragment if e == self.trained else 0) for e in range(self.trained, last + 1)]
        return [unit for unit in units if unit not in self._leases and unit not in self._received]

    def _release(self, incarnation: str, keep: set[Unit]) -> None:
        for unit in [unit for unit, who in self._leases.items() if who == incarnation and unit not in keep]:
            self.end_lease(unit)


def drop_before(unit: Unit, of_units: dict[Unit, Any]) -> None:
    """Forget what comes before a unit: also fragments which their episode, as it turned out, did not have."""
    for past in [past for past in of_units if past < unit]:
        del of_units[past]
