"""What the command line asks of the processes that score policies: one JSON argument, checked on both ends."""

import sys
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import Field, ValidationError

from railctl.common.levels.distributions import AnyLevels, LevelName
from railctl.common.rules.settings import Mode
from railctl.common.strict import ConfigError, Strict, describe

Reference = Literal[
    "random",
    "shortest-path",
    "shortest-path-safe",
    "shortest-path-planned",
    "deadlock-avoidance",
    "deadlock-avoidance-entering",
    "planner",
    "planner-replanned",
    "alone",
]
Demonstrator = Literal["planner", "planner-replanned", "shortest-path-planned"]
PLANNING: tuple[Reference, ...] = ("planner", "planner-replanned")  # references that try orders of trains
DRAWING: tuple[Reference, ...] = ("random", *PLANNING)  # references that draw
ORDERS = 50
MOST_ORDERS = 100_000
MOST_EPISODES = 1_000_000  # of demonstrations, or evaluation levels
FPS = 8.0  # of films, unless it is said
EPISODES = 100  # evaluation levels, if no number is given and so many are held out

R = TypeVar("R", bound=Strict)


class LevelChoice(Strict):
    """What is played: evaluation levels of distributions, or groups of a file.

    Attributes:
        names: of distributions or groups; None: all there is reason for.
        own: distributions of a run file, beside those that everybody knows.
        base: where the paths of their level files start from.
        file: of levels; None: evaluation levels.
        episodes: evaluation levels of each distribution; None: 100, or all that are held out if those are fewer.
        seed: of their sequence; 0 is that which all runs are evaluated on.
        bank: where generated levels may lie ready.
    """

    names: tuple[str, ...] | None = None
    own: dict[LevelName, AnyLevels] = Field(default_factory=dict)
    base: Path = Path()
    file: Path | None = None
    episodes: int | None = Field(default=None, ge=1, le=MOST_EPISODES)
    seed: int = Field(default=0, ge=0)
    bank: Path | None = None


class ScoreRequest(Strict):
    """A checkpoint shall be scored.

    Attributes:
        checkpoint: its file.
        mode: how it acts; None: as its run scores it.
        draws: seed of what is drawn in sampling; None: the run's.
        levels: what it plays.
    """

    checkpoint: Path
    mode: Mode | None = None
    draws: int | None = Field(default=None, ge=0)
    levels: LevelChoice


class ReferenceRequest(Strict):
    """A reference policy shall be scored; `orders` are those of trains that planners try."""

    policy: Reference
    draws: int = Field(default=0, ge=0)
    orders: int = Field(default=ORDERS, ge=1, le=MOST_ORDERS)
    levels: LevelChoice


class PlaybackRequest(Strict):
    """A policy shall play one level, and all that happens be written to a file (see `common.playback`).

    Attributes:
        policy: the name of a reference policy, or None: that of a checkpoint.
        checkpoint: its file, or None.
        mode: how a checkpoint acts; None: as its run scores it.
        draws: seed of what is drawn; None: the run's, for a reference policy 0.
        orders: of trains that planners try.
        levels: of what is played; at most one name is given, and no number of episodes.
        number: of the level: an evaluation level of the distribution, or in the group of the file, from 0.
        observations: whether they are wanted, too.
        file: what to write; another one there is replaced.
    """

    policy: Reference | None = None
    checkpoint: Path | None = None
    mode: Mode | None = None
    draws: int | None = Field(default=None, ge=0)
    orders: int = Field(default=ORDERS, ge=1, le=MOST_ORDERS)
    levels: LevelChoice
    number: int = Field(default=0, ge=0)
    observations: bool = True
    file: Path


class RenderRequest(Strict):
    """Episodes on the same level shall be drawn beside each other.

    Attributes:
        playbacks: files as `PlaybackRequest` has them written.
        titles: what is said above each.
        step: of a .png, the moment that is drawn; None: the last.
        fps: of films, steps a second.
        file: what to write: .gif, .mp4 or .png; another one there is replaced.
    """

    playbacks: tuple[Path, ...] = Field(min_length=1)
    titles: tuple[str, ...] = Field(min_length=1)
    step: int | None = Field(default=None, ge=0)
    fps: float = Field(default=FPS, ge=1, le=50)
    file: Path


class DemonstrationRequest(Strict):
    """A policy shall play training levels as a run would, and what it does be written to a file.

    Attributes:
        policy: the name of a reference policy, or None: that of a checkpoint.
        checkpoint: its file, or None.
        mode: how a checkpoint acts; None: as its run scores it.
        orders: of trains that planners try.
        config: of the run, plain.
        episodes: how many, from the run's first.
        base: where the paths of its level files start from.
        bank: where generated levels may lie ready.
        file: what to write.
    """

    policy: Demonstrator | None = None
    checkpoint: Path | None = None
    mode: Mode | None = None
    orders: int = Field(default=ORDERS, ge=1, le=MOST_ORDERS)
    config: dict[str, Any]
    episodes: int = Field(ge=1, le=MOST_EPISODES)
    base: Path = Path()
    bank: Path | None = None
    file: Path


def asked(model: type[R]) -> R:
    """The request that is this process's one argument; raises ConfigError if it is none."""
    try:
        return model.model_validate_json(sys.argv[1])
    except IndexError:
        raise ConfigError("there is no request: these processes are for the command line") from None
    except ValidationError as error:
        raise ConfigError(describe(error, model)) from None
