"""Level distributions: what a run file says under `levels`, by name. Plain settings; `common.levels.generate` draws.

Three of them ship with the project, `easy`, `medium` and `hard`, as files beside this one.
"""

import hashlib
import json
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Literal, NamedTuple, Self

import yaml
from pydantic import Discriminator, Field, Tag, model_validator

from railctl.common.strict import Share, Strict

ANY = "any"  # what an actor serves that serves all; no name of levels
MOST_TRAINS = 1000
MOST_HELD_OUT = 1000
LARGEST_SIDE = 200
LEAST_SPEED = 0.001  # cells a step: the longest episode takes such a train a hundred cells far

LEVEL_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$"
LevelName = Annotated[str, Field(pattern=LEVEL_PATTERN)]
Rules = Literal["legacy", "stock"]
Side = Annotated[int, Field(ge=6, le=LARGEST_SIDE)]
Speed = Annotated[float, Field(ge=LEAST_SPEED, le=1, allow_inf_nan=False)]
Patterns = Annotated[tuple[str, ...], Field(min_length=1)]


class Bounds(NamedTuple):
    """The most that any level of a distribution, or of several, has."""

    height: int
    width: int
    trains: int


class MalfunctionSettings(Strict):
    """How trains break down; names as in `common.levels.level.Malfunctions`."""

    rate: float = Field(gt=0, le=1, allow_inf_nan=False)
    min_steps: int = Field(ge=1, le=100_000)
    max_steps: int = Field(ge=1, le=100_000)

    @model_validator(mode="after")
    def _least_comes_first(self) -> Self:
        if self.min_steps > self.max_steps:
            raise ValueError(f"min_steps {self.min_steps} exceeds max_steps {self.max_steps}: make one fit the other")
        return self


class GeneratedLevels(Strict):
    """What the generators of both rule sets are told."""

    size: tuple[Side, Side]  # rows, columns
    trains: int = Field(ge=1, le=MOST_TRAINS)
    cities: int = Field(ge=2, le=1000)  # at most
    rails_between_cities: int = Field(default=2, ge=1, le=10)  # at most
    held_out: int = Field(default=100, ge=1, le=MOST_HELD_OUT)  # evaluation levels that are kept from training

    @property
    def bounds(self) -> Bounds:
        """All its levels are of one size."""
        return Bounds(*self.size, self.trains)

    @property
    def evaluation_levels(self) -> int:
        """How many there are that training never sees."""
        return self.held_out

    @property
    def identity(self) -> str:
        """A digest of all that levels depend on: equal ones have equal levels, whatever they are called."""
        content = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.blake2b(content.encode(), digest_size=8).hexdigest()


class LegacyLevels(GeneratedLevels):
    """Levels and rules of flatland 2.2.2, as in the study: speed 1, no timetable, no malfunctions."""

    rules: Literal["legacy"]
    rails_in_city: int = Field(default=3, ge=2, le=10)  # at most


class StockLevels(GeneratedLevels):
    """Levels and rules of flatland-rl 4.3.0."""

    rules: Literal["stock"]
    rail_pairs_in_city: int = Field(default=2, ge=1, le=10)  # at most
    timetable: bool = True  # windows for departure and arrival, and a step limit after them
    speeds: dict[Speed, Share] | None = None  # shares of the trains by cells a step; None: all run at 1
    malfunctions: MalfunctionSettings | None = None

    @model_validator(mode="after")
    def _shares_are_whole(self) -> Self:
        if self.speeds is not None and abs(sum(self.speeds.values()) - 1) > 1e-9:
            raise ValueError(f"the shares of speeds add up to {sum(self.speeds.values()):g}: make it 1")
        return self


Generated = LegacyLevels | StockLevels  # what generators draw from


class LevelFiles(Strict):
    """Levels out of files: flatland's pickles and msgpack, or our .npz.

    Whoever starts a run reads the files and fills in what they hold (`found`); the run keeps a copy of them.
    """

    files: Patterns  # paths, or patterns as levels/*.pkl
    evaluation: Annotated[float, Field(gt=0, lt=1)] | Patterns = 0.2  # a share of them, or files of their own
    rules: Rules = "stock"
    found: "FoundLevels | None" = None

    @model_validator(mode="before")
    @classmethod
    def _one_is_enough(cls, data: Any) -> Any:
        if isinstance(data, dict):
            data = data | {key: [data[key]] for key in ("files", "evaluation") if isinstance(data.get(key), str)}
        return data

    @property
    def bounds(self) -> Bounds:
        return Bounds(*self._there.size, self._there.trains)

    @property
    def evaluation_levels(self) -> int:
        return self._there.evaluation

    @property
    def identity(self) -> str:
        return self._there.digest

    @property
    def _there(self) -> "FoundLevels":
        if self.found is None:
            raise ValueError("the files were not read yet")
        return self.found


Count = Annotated[int, Field(ge=1, le=10_000_000)]


class FoundLevels(Strict):
    """What the files of a distribution hold."""

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]  # of all levels, and of which are kept from training
    size: tuple[Count, Count]  # of the largest
    trains: Count  # the most
    training: Count  # levels
    evaluation: Count  # levels


def _kind(data: Any) -> str:
    if isinstance(data, dict):
        return "files" if "files" in data else str(data.get("rules"))
    return "files" if isinstance(data, LevelFiles) else str(getattr(data, "rules", None))


AnyLevels = Annotated[
    Annotated[LegacyLevels, Tag("legacy")] | Annotated[StockLevels, Tag("stock")] | Annotated[LevelFiles, Tag("files")],
    Discriminator(
        _kind, custom_error_type="levels", custom_error_message="Say rules: legacy or rules: stock, or give files"
    ),
]


@cache
def shipped() -> dict[str, LegacyLevels | StockLevels]:
    """The distributions that ship with the project, the one with the fewest trains first."""
    found = {}
    for path in files("railctl.common.levels.shipped").iterdir():
        if path.name.endswith(".yaml"):
            data = yaml.safe_load(path.read_text())
            model = LegacyLevels if data["rules"] == "legacy" else StockLevels
            found[path.name.removesuffix(".yaml")] = model.model_validate(data)
    return dict(sorted(found.items(), key=lambda item: (item[1].trains, item[0])))
