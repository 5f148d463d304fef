"""What is kept to learn from again."""

from typing import Annotated, Literal

from pydantic import Field, Tag

from common.strict import Strict, by_kind


class UniformReplay(Strict):
    """A ring of the newest transitions, drawn all alike (Lin 1992)."""

    kind: Literal["uniform"] = "uniform"
    capacity: int = Field(ge=1, le=10_000_000)  # transitions


class PrioritizedReplay(Strict):
    """As `UniformReplay`, drawn by priority (Schaul et al. 2016)."""

    kind: Literal["prioritized"] = "prioritized"
    capacity: int = Field(ge=1, le=10_000_000)  # transitions
    alpha: float = Field(default=0.6, ge=0, le=1)  # exponent of the priorities; 0 is uniform
    beta: float = Field(default=0.4, ge=0, le=1)  # of the importance weights, growing to 1 over the run


ReplayConfig = UniformReplay | PrioritizedReplay
AnyReplay = Annotated[
    Annotated[UniformReplay, Tag("uniform")] | Annotated[PrioritizedReplay, Tag("prioritized")], by_kind("uniform")
]


def check_batch(field: str, size: int, replay: ReplayConfig) -> None:
    """Raises ValueError if the replay never holds a batch."""
    if size > replay.capacity:
        raise ValueError(f"{field} {size} exceeds replay.capacity {replay.capacity}: make one fit the other")
