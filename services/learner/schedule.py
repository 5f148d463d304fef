"""Which difficulty each episode has: a function of the configuration's mix and seed."""

from collections.abc import Sequence

from common.config import RunConfig
from common.seeding import stream_key, uniform


def difficulties(config: RunConfig) -> Sequence[str]:
    """The difficulty of each of the run's episodes."""
    if len(config.mix) == 1:
        return [next(iter(config.mix))] * config.episodes
    key = stream_key(config.seed, 0, "difficulty")
    return [_pick(config.mix, uniform(key, episode)) for episode in range(config.episodes)]


def _pick(mix: dict[str, float], draw: float) -> str:
    for difficulty in sorted(mix):
        draw -= mix[difficulty]
        if draw < 0:
            return difficulty
    return max(mix)
