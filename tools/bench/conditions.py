"""What several benchmarks play: the study's levels under its conditions."""

from common.policy.player import compiled_world
from common.policy.rollout import Rollouts
from common.world import study_world


def study_rollouts() -> Rollouts:
    """Plays any level that ships."""
    world = study_world()
    return Rollouts(compiled_world(world, "legacy", world.bounds.trains))
