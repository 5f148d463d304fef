"""All observations."""

from typing import Annotated, Literal

from pydantic import Field, Tag

from common.levels.distributions import Bounds
from common.strict import Strict, by_kind


class TreeObservation(Strict):
    """Trees."""

    kind: Literal["tree"] = "tree"
    depth: int = Field(default=2, ge=1, le=3)
    features: Literal["study", "plain"] = "study"
    conflicts: Literal["library", "repaired"] = "library"

    def n_features(self, bounds: Bounds) -> int:  # noqa: ARG002
        """F."""
        return 12 * (((1 << 2 * self.depth + 2) - 1) // 3)


class GlobalObservation(Strict):
    """Maps."""

    kind: Literal["global"] = "global"

    def n_features(self, bounds: Bounds) -> int:
        """F."""
        return 23 * bounds.height * bounds.width


AnyObservation = Annotated[
    Annotated[TreeObservation, Tag("tree")] | Annotated[GlobalObservation, Tag("global")], by_kind("tree")
]
