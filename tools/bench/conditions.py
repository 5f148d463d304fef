"""What several benchmarks play: the study's levels under its conditions."""

from railctl.common.policy.player import compiled_world
from railctl.common.policy.rollout import Rollouts
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.world import study_world


def study_rollouts(
    observation: AnyObservation = TreeObservation(),  # noqa: B008  (it is frozen)
    interlocking: Interlocking = "off",
) -> Rollouts:
    """Plays any level that ships."""
    world = study_world().model_copy(update={"observation": observation, "interlocking": interlocking})
    return Rollouts(compiled_world(world, "legacy", world.bounds.trains))
