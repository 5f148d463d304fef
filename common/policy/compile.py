"""python -m railctl.common.policy.compile: compiles levels, world and twins, so that no actor's first start has to.

The machine code is kept beside the sources, or in the user's cache where those cannot be written.
"""

import numpy as np

from railctl.common.levels.distributions import StockLevels, shipped
from railctl.common.levels.generate import generate
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.player import Acting, compiled_world, network_layout, play
from railctl.common.policy.rollout import Rollouts
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rules.settings import NetworkConfig
from railctl.common.task import carry_out
from railctl.common.world import WorldSpec


def main() -> None:
    """Generate levels of both kinds; play an episode whole, and one step by step."""
    generate(StockLevels(rules="stock", size=(25, 25), trains=2, cities=2, speeds={1.0: 0.5, 0.5: 0.5}), 0)
    config, spec = NetworkConfig(), WorldSpec(levels={"easy": shipped()["easy"]}, interlocking="planned")
    layout = network_layout(config, spec.n_features)
    twin = Twin(layout)
    twin.load(export_parameters(build_network(config, layout.n_features, layout.n_actions, seed=0)))
    level = LevelSupply(spec.levels).training("easy", 0)
    world = compiled_world(spec, "legacy", level.n_trains)
    play(Rollouts(world), level, Acting(twin, epsilon=0.5))
    world.load(0, level)
    world.observe_deciding()
    twin.in_episode(0.5, 0, twin.zero_state(level.n_trains))(world.observe(0, 0), 0, 0, ALL_ACTIONS)
    world.step(np.zeros((1, level.n_trains), np.int8))


if __name__ == "__main__":
    carry_out(main)
