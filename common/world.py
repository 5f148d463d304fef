"""The world of a run, resolved once: its levels by name, what trains see, where they decide, and what they are paid.

Level supply, engines and learner all get it from here. A checkpoint carries it.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from railctl.common.levels.distributions import ANY, AnyLevels, Bounds, LevelName, shipped
from railctl.common.levels.own import with_files_read
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.rewards.study import StudyReward
from railctl.common.rail.rewards.table import AnyReward
from railctl.common.strict import ConfigError, Strict, describe, nearest, shortened

Decisions = Literal["cells", "legacy", "always"]  # see `common.rail.compiled.decisions`


class WorldSpec(Strict):
    """Everything that a learning curve depends on but the learning."""

    levels: Annotated[dict[LevelName, AnyLevels], Field(min_length=1)]
    observation: AnyObservation = TreeObservation()
    decisions: Decisions = "cells"
    reward: AnyReward = StudyReward()
    interlocking: Interlocking = "off"
    patience: int | None = Field(default=None, ge=1, le=100_000)  # steps that a train may stand that may go, if safe

    @field_validator("levels")
    @classmethod
    def _any_is_no_name(cls, levels: Any) -> Any:
        if ANY in levels:
            raise ValueError(f"{ANY} is what actors serve that serve all levels: choose another name")
        return levels

    @field_validator("interlocking", mode="before")
    @classmethod
    def _off_is_a_word(cls, mode: Any) -> Any:
        return "off" if mode is False else mode  # which YAML takes it for

    @model_validator(mode="after")
    def _somebody_is_patient(self) -> Self:
        if self.patience is not None and self.interlocking not in ("safe", "planned"):
            raise ValueError(
                f"patience {self.patience}: an interlocking {self.interlocking} makes nobody go on, "
                "make it safe or planned, or patience null"
            )
        return self

    @property
    def bounds(self) -> Bounds:
        """The most that any of its levels has."""
        each = [levels.bounds for levels in self.levels.values()]
        return Bounds(*(max(sizes) for sizes in zip(*each, strict=True)))

    @property
    def n_features(self) -> int:
        """F, of what trains see."""
        return self.observation.n_features(self.bounds)


def study_world() -> WorldSpec:
    """All that ships, under the study's conditions."""
    return WorldSpec(levels=dict(shipped()))


def checked_world(data: dict[str, Any]) -> WorldSpec:
    """The world that plain data describes.

    Raises:
        ConfigError: something in it is wrong.
    """
    try:
        return WorldSpec.model_validate(data)
    except ValidationError as error:
        raise ConfigError(describe(error, WorldSpec)) from None


def read_world(data: dict[str, Any], base: Path) -> WorldSpec:
    """The world that plain data describes, its level files read; their relative paths start from `base`.

    Raises:
        ConfigError: something in it is wrong, or a file cannot be read.
    """
    world = checked_world(data)
    return world.model_copy(update={"levels": with_files_read(world.levels, base)})


def chosen_levels(names: Collection[Any], own: Any) -> dict[str, Any]:
    """The distributions of these names, out of a run file's own and those that ship.

    Raises:
        ConfigError: there are no names, there is no distribution of a name, or the run file's are none.
    """
    if not names:
        raise ConfigError("mix names no levels: write for example mix: {easy: 1}")
    if not isinstance(own, dict):
        raise ConfigError(f"levels: input should be a valid dictionary, not {shortened(own)}")
    ours = {name: levels.model_dump(mode="json") for name, levels in shipped().items()}
    for name in ours.keys() & own.keys():
        if own[name] != ours[name]:
            raise ConfigError(f"levels.{name}: these levels ship with the project, give yours another name")
    known = ours | own
    for name in names:
        if name not in known:
            raise ConfigError(f"unknown level {shortened(name)}{nearest(str(name), [str(each) for each in known])}")
    return {name: known[name] for name in names}
