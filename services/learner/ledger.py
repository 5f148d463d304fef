"""The ledger: which episode is waiting, leased, received or trained. Pure: no clock, no bus, no disk.

Episode e acts with the weights after episode e - 1 - lag, so it may be leased once e - lag episodes are trained.
Training is strictly in order. Leases belong to living actors only; a dead actor's episodes wait again.
"""

from collections.abc import Sequence

from common.config import Difficulty
from common.records import Episode


class Ledger:
    """The account of the episodes 0..N-1 of a run."""

    def __init__(self, difficulties: Sequence[Difficulty], lag: int, trained: int = 0) -> None:
        self.difficulties = difficulties
        self._lag = lag
        self.trained = trained  # episodes below this number are trained
        self._leases: dict[int, str] = {}  # episode -> incarnation of its actor
        self._received: dict[int, Episode] = {}
        self._alive: set[str] = set()
        self.duplicates = 0
        self.reissued = 0

    @property
    def total(self) -> int:
        return len(self.difficulties)

    @property
    def finished(self) -> bool:
        return self.trained == self.total

    @property
    def leased(self) -> int:
        return len(self._leases)

    def weights_version(self, episode: int) -> int:
        """The version of the weights that an episode acts with: version v is after v trained episodes."""
        return max(0, episode - self._lag)

    def waiting(self) -> dict[Difficulty, int]:
        """How many episodes of each difficulty could be acted now but are not."""
        counts: dict[Difficulty, int] = {}
        for episode in self._free():
            difficulty = self.difficulties[episode]
            counts[difficulty] = counts.get(difficulty, 0) + 1
        return counts

    def actor_came(self, incarnation: str) -> None:
        """An actor lives; only now can it hold leases."""
        self._alive.add(incarnation)

    def actor_gone(self, incarnation: str) -> None:
        """An actor died: what it had leased waits again."""
        self._alive.discard(incarnation)
        self._release(incarnation, keep=set())

    def missing(self, incarnation: str, kept: Sequence[int]) -> list[int]:
        """Of the episodes that an actor keeps, those that the learner lacks; they count as leased to it.

        An actor asks only when it acts nothing, so leases of its that it does not keep never reached it, and end.
        """
        wanted = [e for e in kept if self.trained <= e < self.total and e not in self._received]
        self._release(incarnation, keep=set(wanted))
        if incarnation in self._alive:
            self._leases.update(dict.fromkeys(wanted, incarnation))
        return wanted

    def grant(self, incarnation: str, serves: str) -> int | None:
        """Lease the first waiting episode of a served difficulty to a living actor; none if there is none."""
        if incarnation not in self._alive:
            return None
        for episode in self._free():
            if serves in ("any", self.difficulties[episode]):
                self._leases[episode] = incarnation
                return episode
        return None

    def receive(self, episode: Episode) -> bool:
        """Take an episode in; false for one that is there or trained already."""
        number = episode.episode
        if number < self.trained or number in self._received:
            self.duplicates += 1
            return False
        self._leases.pop(number, None)
        self._received[number] = episode
        return True

    def next_ready(self) -> Episode | None:
        """The episode to be trained now, if it is here."""
        return self._received.get(self.trained)

    def mark_trained(self) -> None:
        """The episode that `next_ready` named is trained."""
        del self._received[self.trained]
        self.trained += 1

    def _free(self) -> list[int]:
        last = min(self.trained + self._lag, self.total - 1)
        return [e for e in range(self.trained, last + 1) if e not in self._leases and e not in self._received]

    def _release(self, incarnation: str, keep: set[int]) -> None:
        for episode in [e for e, who in self._leases.items() if who == incarnation and e not in keep]:
            del self._leases[episode]
            self.reissued += 1
