"""What is kept to learn from again."""

from typing import Annotated, Literal, Self

from pydantic import Field, Tag, model_validator

from railctl.common.strict import Strict, by_kind


class UniformReplay(Strict):
    """A ring of the newest transitions, drawn all alike (Lin 1992)."""

    kind: Literal["uniform"] = "uniform"
    capacity: int = Field(ge=1, le=10_000_000)  # transitions


class PrioritizedReplay(Strict):
    """As `UniformReplay`, drawn by priority (Schaul et al. 2016).

    Attributes:
        alpha: exponent of the priorities; 0 is uniform.
        alpha_end: what alpha falls to over the run (the study, section 2.2.3.5); None: it stays.
        beta: of the importance weights, growing to 1 over the run.
    """

    kind: Literal["prioritized"] = "prioritized"
    capacity: int = Field(ge=1, le=10_000_000)  # transitions
    alpha: float = Field(default=0.6, ge=0, le=1)
    alpha_end: float | None = Field(default=None, ge=0, le=1)
    beta: float = Field(default=0.4, ge=0, le=1)

    @model_validator(mode="after")
    def _alpha_falls(self) -> Self:
        if self.alpha_end is not None and self.alpha_end > self.alpha:
            raise ValueError(f"alpha_end {self.alpha_end:g} exceeds alpha {self.alpha:g}: alpha falls, make it less")
        return self

    def exponent(self, progress: float) -> float:
        """Alpha after a share of the run."""
        if self.alpha_end is None:
            return self.alpha
        return self.alpha + (self.alpha_end - self.alpha) * min(1.0, progress)


ReplayConfig = UniformReplay | PrioritizedReplay
AnyReplay = Annotated[
    Annotated[UniformReplay, Tag("uniform")] | Annotated[PrioritizedReplay, Tag("prioritized")], by_kind("uniform")
]


def check_batch(field: str, size: int, replay: ReplayConfig) -> None:
    """Raises ValueError if the replay never holds a batch."""
    if size > replay.capacity:
        raise ValueError(f"{field} {size} exceeds replay.capacity {replay.capacity}: make one fit the other")
