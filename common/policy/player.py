"""Playing a leased episode with whichever engine the run has; both give the same episode, to the bit."""

from collections.abc import Callable
from typing import Literal

from common.config import NetworkConfig
from common.levels.level import Level
from common.policy.compiled import Twin
from common.policy.packing import Layout
from common.rail.normalise import N_FEATURES
from common.rail.play import Recording, play
from common.rail.world import N_ACTIONS

MAX_TRAINS = 7  # of the hardest difficulty
Engine = Literal["compiled", "flatland"]
Player = Callable[[Level, Twin, float, int], Recording]  # level, network, epsilon, key of the exploration stream


def network_layout(config: NetworkConfig) -> Layout:
    """How the run's network is laid out for its compiled twin."""
    return Layout(config.kind, N_FEATURES, N_ACTIONS, config.hidden)


def player(engine: Engine, max_trains: int, on_step: Callable[[], None]) -> Player:
    """What plays an episode. `on_step` is called before every step, or before every episode that takes milliseconds."""
    if engine == "compiled":
        from common.policy.rollout import Rollouts  # noqa: PLC0415  (each engine spares the other's imports)

        rollouts = Rollouts(max_trains)

        def compiled(level: Level, twin: Twin, epsilon: float, key: int) -> Recording:
            on_step()
            return rollouts.play(level, twin, epsilon, key)

        return compiled
    from common.rail.flatland_world import FlatlandWorld  # noqa: PLC0415

    world = FlatlandWorld(slots=1, max_trains=max_trains)

    def stepped(level: Level, twin: Twin, epsilon: float, key: int) -> Recording:
        return play(world, [level], [twin.in_episode(epsilon, key, level.n_trains)], on_step)[0]

    return stepped
