"""The account of a run: its rows, its pace, and when snapshots and checkpoints fall due. Pure: times come in."""

from collections import deque
from collections.abc import Iterable

from railctl.common.recent import RECENT_EPISODES, mean_of
from railctl.common.records.rows import EpisodeRow
from railctl.services.learner.opened import OpenEpisode

RATE_WINDOW_S = 30.0


class Account:
    """Steps, returns and pace of a run.

    Attributes:
        steps: environment steps of all trained episodes.
    """

    def __init__(self, rows: Iterable[EpisodeRow], now: float) -> None:
        """`rows` are those of all episodes that are trained already; `now` is any clock's, in seconds."""
        self.steps = 0
        self._returns: deque[float] = deque(maxlen=RECENT_EPISODES)
        self._staleness: deque[int] = deque(maxlen=RECENT_EPISODES)
        self._ends: deque[tuple[float, int]] = deque([(now, 0)])  # of the last episodes: when, and of how many steps
        for row in rows:
            self._count(row)

    def end_episode(self, row: EpisodeRow, now: float) -> None:
        """Another episode is trained."""
        self._count(row)
        self._ends.append((now, row.steps))

    @property
    def mean_return(self) -> float | None:
        """Of the last `RECENT_EPISODES` episodes; None before the first."""
        return mean_of(self._returns)

    @property
    def mean_staleness(self) -> float | None:
        """As `mean_return`."""
        return mean_of(self._staleness)

    def pace(self, now: float) -> tuple[float, float]:
        """Episodes and environment steps a second, over about the last `RATE_WINDOW_S`."""
        while len(self._ends) > 1 and self._ends[0][0] < now - RATE_WINDOW_S:
            self._ends.popleft()
        elapsed = max(now - self._ends[0][0], 1e-3)
        return (len(self._ends) - 1) / elapsed, sum(steps for _, steps in list(self._ends)[1:]) / elapsed

    def _count(self, row: EpisodeRow) -> None:
        self.steps += row.steps
        self._returns.append(row.normalised_return)
        self._staleness.append(row.staleness or 0)


def is_due(trained: int, every: int, *, finished: bool) -> bool:
    """Whether something that happens every so many episodes, and at the end, happens after `trained` of them."""
    return finished or trained % every == 0


def row_of(episode: OpenEpisode, version: int, trained_unix_s: float) -> EpisodeRow:
    """The row of an episode whose last fragment is trained; `version` is that of the weights after it."""
    first, last = episode.fragments[0], episode.fragments[-1]
    return EpisodeRow(
        episode=last.lease.episode,
        level=last.lease.level,
        seed=last.lease.level_seed,
        normalised_return=last.course.normalised_return,
        arrived=int((last.course.arrived_at >= 0).sum()),
        trains=last.course.n_trains,
        steps=episode.steps,
        decisions=episode.decisions,
        epsilon=last.lease.epsilon,
        weights_version=first.lease.weights_version,
        digest=episode.digest,
        actor=last.circumstances.actor,
        acting_s=round(episode.acting_s, 4),
        trained_unix_s=round(trained_unix_s, 3),
        learned_reward=episode.reward,
        score=last.course.score,
        staleness=episode.staleness(version),
    )
