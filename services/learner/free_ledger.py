"""A ledger whose episodes act with the newest weights there are when they are leased.

As many may be under way as with a lag of the same depth, so the weights are never older than that lag's. They are
fresher in two ways: an actor that comes late gets what has been trained meanwhile; and as long as training has enough
at hand, nothing is leased, for it would only wait and grow stale. Enough is what bridges the time until actors bring
more: with less, training would wait where episodes take very different times; with more, all would only be staler.
"""

from railctl.services.learner.ledger import Ledger, Unit

ENOUGH = 2  # episodes for each actor


class FreeLedger(Ledger):
    """The account of a run with `lag: free`; its lag is how stale weights may be."""

    def weights_version(self, episode: int) -> int:  # noqa: ARG002  (the same for all)
        """The newest."""
        return self.version

    def versions(self, episode: int) -> range:
        """From that which the lag would name to the last before the episode is trained."""
        return range(super().weights_version(episode), self._version_after(episode) + 1)

    def _to_lease(self) -> list[Unit]:
        return [] if self._has_enough else super()._to_lease()

    @property
    def _has_enough(self) -> bool:
        return self.next_ready() is not None and len(self._received) > ENOUGH * len(self._alive)
