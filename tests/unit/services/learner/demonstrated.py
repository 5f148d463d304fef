"""Episodes as a demonstrator plays them, in the world of runs on easy."""

import numpy as np

from railctl.common.records.course import Course, Decisions
from railctl.common.world import WorldSpec, study_world

WORLD = WorldSpec(levels={"easy": study_world().levels["easy"]})


def course(number=0, actions=(2, 4), first_step=0):
    """An episode in which two trains decide: the first arrives, the second does not."""
    count = len(actions)
    return Course(
        level_hash=f"{number:032x}",
        max_steps=40,
        first_step=first_step,
        over=True,
        decisions=Decisions(
            observations=np.full((count, WORLD.n_features), number, np.float32),
            times=np.full(count, first_step, np.int32),
            trains=np.arange(count, dtype=np.int32),
            actions=np.array(actions, np.int8),
            allowed=np.full(count, 31, np.uint8),
            log_probabilities=np.zeros(count, np.float32),
            values=np.zeros(count, np.float32),
            labels=np.full(count, -1, np.int8),
            following=np.zeros((count, 0), np.float32),
        ),
        rewards=np.zeros((3, 2), np.float32),
        arrived_at=np.array([2, -1], np.int32),
        final_observations=np.zeros((2, WORLD.n_features), np.float32),
        final_allowed=np.full(2, 31, np.uint8),
        states=np.zeros((2, 0), np.float32),
    )
