"""What several benchmarks play: the study's levels under its conditions."""

from common.policy.player import compiled_world
from common.policy.rollout import Rollouts
from common.rail.interlocking.signals import Interlocking
from common.rail.observations.table import AnyObservation
from common.rail.observations.tree import TreeObservation
from common.world import study_world


def study_rollouts(
    observation: AnyObservation = TreeObservation(),  # noqa: B008  (it is frozen)
    interlocking: Interlocking = "off",
) -> Rollouts:
    """Plays any level that ships."""
    world = study_world().model_copy(update={"observation": observation, "interlocking": interlocking})
    return Rollouts(compiled_world(world, "legacy", world.bounds.trains))
