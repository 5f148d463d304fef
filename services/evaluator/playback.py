"""python -m railctl.services.evaluator.playback REQUEST: writes down one episode, for looking at (see `common.playback`).

It is the episode of the evaluator: same level, same draws, same malfunctions, so the return is that which
`services.evaluator.score` has for this level. How it answers: see `common.task`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from railctl.common.checkpoint import CheckpointError
from railctl.common.folder import write_atomically
from railctl.common.levels.chunks import BankError
from railctl.common.levels.files import LevelFileError
from railctl.common.levels.level import InfeasibleLevelError, Level
from railctl.common.playback import (
    FeatureGroup,
    Features,
    Playback,
    PlayedDecision,
    PlayedLevel,
    PlayedMalfunctions,
    PlayedResult,
    PlayedTrain,
)
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.player import Stepped, conditions
from railctl.common.rail.observations.names import groups_of as named_groups
from railctl.common.rail.play import Stage
from railctl.common.rail.world import N_ACTIONS
from railctl.common.records.course import Course
from railctl.common.requests import PLANNING, PlaybackRequest, asked
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say
from railctl.services.evaluator.groups import Group, known_to_all, one_of
from railctl.services.evaluator.recording import Note, Take, WatchedNetwork, WatchedWorld, side_by_side
from railctl.services.evaluator.references.policies import reference_policy, reference_world
from railctl.services.evaluator.runner import Policy, UnplayableLevelError, course_of, greedy, sampled
from railctl.services.evaluator.score import draws_seed, known_to

DECIMALS = 4  # of observations and scores


@dataclass(frozen=True)
class Episode:
    """What was played by whom, and what was seen of it."""

    policy: str
    group: Group
    level: Level
    take: Take
    course: Course
    decisions: list[PlayedDecision]
    features: Features | None = None


def play_back(request: PlaybackRequest) -> None:
    """Play the level, write the document, and say what became of it."""
    teller = Teller("episode")
    teller.tell(0, 1)
    if request.policy is not None:
        episode = by_reference(request)
    elif request.checkpoint is not None:
        episode = by_checkpoint(request, request.checkpoint)
    else:
        raise ConfigError("policy and checkpoint are missing: give one of them")
    document = document_of(episode, request)
    write_atomically(request.file, document.model_dump_json(by_alias=True))
    teller.tell(1, 1)
    say(
        {
            "file": str(request.file),
            "policy": document.policy,
            "level": {"name": document.level.name, "number": document.level.number},
            "result": document.result.model_dump(by_alias=True),
        }
    )


def by_checkpoint(request: PlaybackRequest, path: Path) -> Episode:
    """The episode as the network of a checkpoint plays it."""
    saved = load_policy(path)
    draws = draws_seed(request, saved)
    group, level = one_of(request.levels, request.number, known_to(saved, path, request.levels))
    spec, network = saved.config.world, WatchedNetwork(saved.network)
    world = WatchedWorld(group.most_trains, **conditions(spec, group.rules))
    player = Stepped(Stage(world))
    policy = greedy(player, network) if draws is None else sampled(player, network, draws)
    course = played(policy, request, group, level)
    groups = [FeatureGroup(name=name, names=list(names)) for name, names in named_groups(spec.observation)]
    return Episode(
        f"{saved.config.algorithm} after {saved.episode} episodes, {'greedy' if draws is None else 'sample'}",
        group,
        level,
        side_by_side(world.takes),
        course,
        [decision_of(note, observed=request.observations, is_policy=network.is_policy) for note in network.notes],
        Features(kind=spec.observation.kind, count=spec.n_features, groups=groups),
    )


def by_reference(request: PlaybackRequest) -> Episode:
    """The episode as a policy plays it that looks at the world itself."""
    assert request.policy is not None  # noqa: S101  (who calls has looked)
    known = known_to_all(request.levels)
    group, level = one_of(request.levels, request.number, known)
    spec = reference_world(request.policy, known.levels)
    world = WatchedWorld(group.most_trains, **conditions(spec, group.rules))
    policy = reference_policy(request.policy, world, request.draws or 0, request.orders)
    course = played(policy, request, group, level)
    take = side_by_side(world.takes)
    orders = f", the best of {request.orders} orders" if request.policy in PLANNING else ""
    return Episode(f"{request.policy}{orders}", group, level, take, course, told_decisions(course, take))


def played(policy: Policy, request: PlaybackRequest, group: Group, level: Level) -> Course:
    """The episode of a level.

    Raises:
        UnplayableLevelError: it cannot be played.
    """
    try:
        return course_of(policy, request.number, level)
    except UnplayableLevelError as error:
        where = request.levels.file or "evaluation levels"
        raise UnplayableLevelError(f"{where}: {group.name}, {error}") from error


def decision_of(note: Note, *, observed: bool, is_policy: bool) -> PlayedDecision:
    """What a network was asked, and its answer."""
    scores = note.outputs[:N_ACTIONS].astype(np.float64)
    allowed = [action for action in range(N_ACTIONS) if note.allowed >> action & 1]
    if is_policy:
        weights = np.zeros(N_ACTIONS)
        weights[allowed] = np.exp(scores[allowed] - scores[allowed].max())
        scores = weights / weights.sum()
    return PlayedDecision(
        step=note.step,
        train=note.train,
        action=note.action,
        allowed=allowed,
        scores=_rounded(scores),
        scores_are="probabilities" if is_policy else "action values",
        value=round(float(note.outputs[-1]), DECIMALS) if is_policy else None,
        observation=_rounded(note.observation) if observed else None,
    )


def _rounded(numbers: Any) -> list[float]:
    """As short as can be told apart; 0 for -0."""
    short: list[float] = (np.round(numbers.astype(np.float64), DECIMALS) + 0.0).tolist()
    return short


def told_decisions(course: Course, take: Take) -> list[PlayedDecision]:
    """Of what all trains were told in every step: what deciding ones were told, and what was news to others."""
    decisions, before = course.decisions, np.full(course.n_trains, -1)
    found = []
    for step, train, action in zip(
        decisions.times.tolist(), decisions.trains.tolist(), decisions.actions.tolist(), strict=True
    ):
        if take.deciding[step, train] or action != before[train]:
            found.append(
                PlayedDecision(
                    step=step,
                    train=train,
                    action=action,
                    allowed=None,
                    scores=None,
                    scores_are=None,
                    value=None,
                    observation=None,
                )
            )
        before[train] = action
    return found


def document_of(episode: Episode, request: PlaybackRequest) -> Playback:
    """All of it."""
    course = episode.course
    return Playback(
        policy=episode.policy,
        level=played_level(episode.group, episode.level, request),
        features=episode.features,
        steps=episode.take.moments.tolist(),
        decisions=episode.decisions,
        result=PlayedResult.model_validate(
            {
                "return": course.normalised_return,
                "arrived": int((course.arrived_at >= 0).sum()),
                "trains": course.n_trains,
                "steps": course.last_step,
                "score": course.score,
            }
        ),
    )


def played_level(group: Group, level: Level, request: PlaybackRequest) -> PlayedLevel:
    """The level as the document has it."""
    height, width = level.grid.shape
    schedule, file = level.schedule, request.levels.file
    malfunctions = None if schedule is None else schedule.malfunctions
    return PlayedLevel(
        name=group.name,
        number=request.number,
        seed=request.levels.seed if file is None else None,
        file=None if file is None else str(file),
        height=height,
        width=width,
        grid=level.grid.tolist(),
        max_steps=level.max_steps,
        trains=[played_train(level, train) for train in range(level.n_trains)],
        malfunctions=None if malfunctions is None else PlayedMalfunctions(**malfunctions._asdict()),
    )


def played_train(level: Level, train: int) -> PlayedTrain:
    """What a train is to do."""
    schedule = level.schedule
    numerator, denominator = (1, 1) if schedule is None else schedule.speeds[train].tolist()
    return PlayedTrain(
        start=level.starts[train].tolist(),
        target=level.targets[train].tolist(),
        speed=numerator / denominator,
        departs=None if schedule is None else int(schedule.earliest_departures[train]),
        due=None if schedule is None else int(schedule.latest_arrivals[train]),
    )


def main() -> None:
    carry_out(
        lambda: play_back(asked(PlaybackRequest)),
        *(CheckpointError, LevelFileError, BankError, UnplayableLevelError, InfeasibleLevelError),
    )


if __name__ == "__main__":
    main()
