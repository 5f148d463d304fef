"""An episode to look at, made by hand: two trains on a line with a siding, one of which waits for the other."""

from railctl.common.playback import (
    FeatureGroup,
    Features,
    Playback,
    PlayedDecision,
    PlayedLevel,
    PlayedResult,
    PlayedTrain,
)

WIDTH = 12
EAST_WEST = 0b0000010000000001  # a straight track, both ways
STEPS = 9
WAITING, MOVING, STOPPED, ARRIVED = 0, 1, 2, 4


def _moments(train):
    """The first drives at once, the second waits three steps and stands for one."""
    row, start = 1 + train, 1
    for step in range(STEPS + 1):
        if train == 0:
            driven, state = min(step, 6), MOVING if step < 6 else ARRIVED
        elif step < 3:
            driven, state = 0, WAITING
        else:
            driven, state = max(0, min(step - 4, 4)), STOPPED if step == 4 else MOVING
        yield (state, row, start + driven, 1, 0, 0)


def made_playback(policy="made after 100 episodes, greedy"):
    """As `services.evaluator.playback` writes one."""
    grid = [[EAST_WEST if row in (1, 2) else 0 for _ in range(WIDTH)] for row in range(4)]
    trains = [
        PlayedTrain(start=(1 + at, 1, 1), target=(1 + at, 7 - at), speed=1.0, departs=None, due=None) for at in (0, 1)
    ]
    level = {"name": "easy", "number": 0, "seed": 0, "file": None, "height": 4, "width": WIDTH, "max_steps": 50}
    result = {"return": -0.125, "arrived": 1, "trains": 2, "steps": STEPS, "score": None}
    groups = {"this train": ["near", "far"], "others": ["closeness"]}
    decisions = [
        PlayedDecision(
            step=step,
            train=train,
            action=2,
            allowed=[2, 4],
            scores=[0.0, 0.0, 0.75, 0.0, 0.25],
            scores_are="probabilities",
            value=-0.5,
            observation=[1.0, 0.0, 0.25],
        )
        for train, step in ((0, 0), (1, 3), (0, 4))
    ]
    return Playback(
        policy=policy,
        level=PlayedLevel(**level, grid=grid, trains=trains, malfunctions=None),
        features=Features(
            kind="made", count=3, groups=[FeatureGroup(name=name, names=names) for name, names in groups.items()]
        ),
        steps=[list(rows) for rows in zip(_moments(0), _moments(1), strict=True)],
        decisions=sorted(decisions, key=lambda one: (one.step, one.train)),
        result=PlayedResult.model_validate(result),
    ).model_dump_json(by_alias=True)
