"""All rewards."""

from typing import Annotated, ClassVar, Literal

from pydantic import Tag

from common.strict import Strict, by_kind


class StudyReward(Strict):
    """The study's."""

    kind: Literal["study"] = "study"
    floor: ClassVar[float] = -1.0


class DelayReward(Strict):
    """The library's."""

    kind: Literal["delay"] = "delay"
    floor: ClassVar[float] = 0.0


AnyReward = Annotated[Annotated[StudyReward, Tag("study")] | Annotated[DelayReward, Tag("delay")], by_kind("study")]
