"""The reference policies by name, as `services.evaluator.runner` plays them.

| | |
|---|---|
| random | any action where a train decides: how an untrained network explores |
| shortest-path | onward, never waiting for another train; of equally short ways the leftmost |
| shortest-path-safe, shortest-path-planned | see `interlocked`: onward as far as their interlocking allows |
| deadlock-avoidance, deadlock-avoidance-entering | see `deadlock_avoidance`; the second with entering prevention |
| planner | see `planner`: knows all of the level, plans before the first step |
| planner-replanned | see `replanner`: plans anew wherever a train decides |
| alone | every train as if there were no others: a bound that no policy can pass, not a policy |
"""

from collections.abc import Mapping
from functools import partial

from railctl.common.levels.distributions import AnyLevels
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.requests import ORDERS, Reference
from railctl.common.world import WorldSpec
from railctl.services.evaluator.references.deadlock_avoidance import deadlock_avoidance
from railctl.services.evaluator.references.interlocked import interlocked_shortest_path
from railctl.services.evaluator.references.performing import Begin, policy_of
from railctl.services.evaluator.references.planner import planner
from railctl.services.evaluator.references.replanner import replanner
from railctl.services.evaluator.references.simple import alone, at_random, shortest_path
from railctl.services.evaluator.runner import Policy

INTERLOCKINGS: Mapping[Reference, Interlocking] = {"shortest-path-safe": "safe", "shortest-path-planned": "planned"}


def reference_world(name: Reference, levels: Mapping[str, AnyLevels]) -> WorldSpec:
    """The world that the policy of a name plays such levels in."""
    return WorldSpec(levels=dict(levels), interlocking=INTERLOCKINGS.get(name, "off"))


def reference_policy(name: Reference, world: CompiledWorld, seed: int = 0, orders: int = ORDERS) -> Policy:
    """The policy of a name.

    Args:
        name: see above.
        world: where it plays, in slot 0; as `reference_world` says.
        seed: of what it draws; what a level is played with depends on nothing but this and the level's number.
        orders: of planners.
    """
    begins: dict[Reference, Begin] = {
        "random": partial(at_random, seed),
        "shortest-path": shortest_path,
        "shortest-path-safe": interlocked_shortest_path,
        "shortest-path-planned": interlocked_shortest_path,
        "deadlock-avoidance": partial(deadlock_avoidance, entering_prevention=False),
        "deadlock-avoidance-entering": partial(deadlock_avoidance, entering_prevention=True),
        "planner": partial(planner, seed, orders),
        "planner-replanned": partial(replanner, seed, orders),
    }
    return alone(policy_of(world, shortest_path)) if name == "alone" else policy_of(world, begins[name])
