"""What is shown of a run's last episodes."""

from collections.abc import Iterable

RECENT_EPISODES = 100


def mean_of(values: Iterable[float]) -> float | None:
    """The mean; None of nothing."""
    found = list(values)
    return sum(found) / len(found) if found else None
