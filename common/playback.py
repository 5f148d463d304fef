"""A playback document: one episode for looking at, as `services.evaluator.playback` writes it, in JSON.

T steps have T + 1 moments, the first of which is before the first step. A moment has a row of six whole numbers a
train, in the order of `TRAIN_FIELDS`:

| field | |
|---|---|
| state | a number of `STATES` |
| row, column, heading | where it is; where it will depart while it waits, where it arrived once it has |
| malfunction | steps that it stays broken down, also before it departs |
| flags | a bit each: `JAMMED`, `LATE` |

A heading is 0 north, 1 east, 2 south, 3 west. A train is jammed if nothing that trains decide ever gets it out of its
cell (`common.rail.rewards.deadlocks`), and late if it is, or arrived, after its latest arrival, which timetables know.
"""

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

FORMAT: Final = 1
ACTIONS: Final = ("do nothing", "left", "forward", "right", "stop")
STATES: Final = ("waiting", "moving", "stopped", "broken", "arrived")
WAITING, MOVING, STOPPED, BROKEN, ARRIVED = range(5)
TRAIN_FIELDS: Final = ("state", "row", "column", "heading", "malfunction", "flags")
JAMMED, LATE = 1, 2  # of the flags

ScoresAre = Literal["action values", "probabilities"]
TrainRow = tuple[int, int, int, int, int, int]


class Part(BaseModel):
    """A frozen part of the document. Not `Strict`, whose guards would cost a call for each of millions of numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PlayedTrain(Part):
    """What a train is to do.

    Attributes:
        start: row, column, heading.
        target: row, column.
        speed: at most, in cells a step.
        departs: the step from which it may; None: there is no timetable.
        due: the step after which its arrival is late; likewise.
    """

    start: tuple[int, int, int]
    target: tuple[int, int]
    speed: float
    departs: int | None
    due: int | None


class PlayedMalfunctions(Part):
    """How trains break down: `common.levels.level.Malfunctions`."""

    rate: float
    min_steps: int
    max_steps: int


class PlayedLevel(Part):
    """What was played.

    Attributes:
        name: of the distribution, or of the group in a file.
        number: of the evaluation level, or in the group, from 0.
        seed: of the sequence of evaluation levels; None: the level is of a file.
        file: its path as it was given; None: it is of a distribution.
        height: in cells.
        width: likewise.
        grid: [H][W], flatland's transition maps.
        max_steps: the step limit.
        trains: [N].
        malfunctions: what breaks trains down; None: nothing does.
    """

    name: str
    number: int
    seed: int | None
    file: str | None
    height: int
    width: int
    grid: list[list[int]]
    max_steps: int
    trains: list[PlayedTrain]
    malfunctions: PlayedMalfunctions | None


class FeatureGroup(Part):
    """Numbers of an observation that lie beside each other, and what they are of."""

    name: str
    names: list[str]


class Features(Part):
    """What a train sees.

    Attributes:
        kind: of the observation.
        count: F.
        groups: what all F numbers mean, one after the other; empty where they are a picture: maps.
    """

    kind: str
    count: int
    groups: list[FeatureGroup]


class PlayedDecision(Part):
    """What a train did where it decided, in the order in which trains were asked.

    Reference policies tell all trains something in every step; of that there is what they say to trains that decide,
    and what is not what they said in the step before.

    Attributes:
        step: of the decision: it is taken in moment `step`, the moment after it shows what comes of it.
        train: from 0.
        action: a number of `ACTIONS`.
        allowed: actions; None: nobody asked for permission.
        scores: [5], of the actions; None: the policy is no network. Probabilities are 0 for what is not allowed.
        scores_are: what they are.
        value: what a policy's network expects to be paid from here on; None: it does not say.
        observation: [F]; None: nothing was observed, or observations are not wanted.
    """

    step: int
    train: int
    action: int
    allowed: list[int] | None
    scores: list[float] | None
    scores_are: ScoresAre | None
    value: float | None
    observation: list[float] | None


class PlayedResult(Part):
    """What became of it; `score` is flatland-rl 4.3.0's own, None under other rules."""

    normalised_return: float = Field(alias="return", serialization_alias="return")
    arrived: int
    trains: int
    steps: int
    score: float | None


class Playback(Part):
    """An episode; `features` is None for policies that look at the world itself."""

    format: Literal[1] = FORMAT
    policy: str
    level: PlayedLevel
    actions: tuple[str, ...] = ACTIONS
    states: tuple[str, ...] = STATES
    train_fields: tuple[str, ...] = TRAIN_FIELDS
    features: Features | None
    steps: list[list[TrainRow]]
    decisions: list[PlayedDecision]
    result: PlayedResult
