"""How much faster whole episodes are than in a plain loop over flatland-rl 4.3.0 and torch: `railctl bench policy`.

Both play the same episodes of the study, from their levels to their ends: the same network chooses, now and then at
random. Ours is what actors run, `Rollouts.play`. Theirs is what a user of the library writes: a `RailEnv` with the
study's rewards and start, the library's own trees of depth 2, flattened and normalised with numpy, one forward pass of
torch a step for the trains that decide, one thread, an epsilon-greedy action for each, a step.

Their trees are those of 4.3.0, so they would choose otherwise now and then. Hence ours plays first; theirs does all
the work of choosing, and then steps with what ours did. In the end all rewards, step by step, must be the same.

With `--observation traffic` ours sees that, and theirs still trees; with `--interlocking planned` ours asks what trains
may do before it chooses, and theirs does not: the library has nothing like either.

The network's weights are random, but for a few that make it follow the shortest paths, as a trained one learns first:
episodes are as long, and trains as jammed, as in training.

"step" counts a step of one world: of theirs the loop alone, of ours the loading of the level and the recording of the
episode, too. "episode" counts theirs from `reset`, for which the level is given: with its distances and first trees.
Theirs pays neither for the level, nor for the rules of 2.2.2 (what to say to 4.3.0 so that it does what 2.2.2 did is
found beforehand), nor for finding out who decides, nor for a predictor, which changes no tree in 4.3.0. It does pay for
the trees of all trains in every step, as the library gives them; ours looks only where a train decides.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, get_args

import numpy as np
import torch
from flatland.envs.observations import TreeObsForRailEnv
from flatland.envs.rail_env_action import RailEnvActions
from numpy.typing import NDArray

from railctl.common.levels.distributions import shipped
from railctl.common.levels.level import Level
from railctl.common.levels.shipped import generate
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import QNetwork, build_network, export_parameters, import_parameters
from railctl.common.policy.player import Acting, network_layout, play
from railctl.common.rail.flatland_env import LegacyActions, LevelEnv, StudyRewards
from railctl.common.rail.interlocking.signals import Interlocking
from railctl.common.rail.normalise import N_NODE_FEATURES, N_NODES, normalise
from railctl.common.rail.observations.table import AnyObservation
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.traffic_shape import N_EXIT, N_TRAIN
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.plain_env import StartReady, plain_environment
from railctl.common.rail.world import MOVE_FORWARD, MOVE_LEFT, MOVE_RIGHT, N_ACTIONS
from railctl.common.records.course import Course
from railctl.common.rules.settings import NetworkConfig
from railctl.common.seeding import stream_key
from railctl.tools.bench.conditions import study_rollouts
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, run, timed
from railctl.tools.levels.library import forget_rails

DEPTH = 2
EPSILON = 0.1
PASSES = 10  # ours plays all of its episodes so often, or it would be over before it can be timed
NETWORK = NetworkConfig(kind="dueling")
OBSERVATIONS: dict[str, AnyObservation] = {"tree": TreeObservation(), "traffic": TrafficObservation()}
NODE_OF = {MOVE_LEFT: 1, MOVE_FORWARD: 6, MOVE_RIGHT: 11}  # what lies that way, in the order of `normalise`
DETOUR = 6  # the feature of a node, of [-1, 0]; 0: no way
IS_SHORTEST = 5  # the number of an exit, 0 or 1
CERTAIN = 100.0  # far more than the random weights say

_Orders = dict[int, RailEnvActions]


def pathfinder(observation: str = "tree") -> QNetwork:
    """A network that takes the way with the least detour."""
    network = build_network(NETWORK, OBSERVATIONS[observation].n_features(None), N_ACTIONS, seed=0)
    parameters = export_parameters(network)
    for unit, (action, node) in enumerate(NODE_OF.items()):
        for layer in ("hidden.0", "hidden.1"):
            parameters[f"{layer}.weight"][unit] = parameters[f"{layer}.bias"][unit] = 0
        if observation == "tree":
            parameters["hidden.0.weight"][unit, node * N_NODE_FEATURES + DETOUR] = -1
        else:
            parameters["hidden.0.weight"][unit, N_TRAIN + unit * N_EXIT + IS_SHORTEST] = 1
        parameters["hidden.1.weight"][unit, unit] = 1
        parameters["advantage.weight"][:, unit] = 0
        parameters["advantage.weight"][action, unit] = CERTAIN
    import_parameters(network, parameters)
    return network


@dataclass
class Script:
    """An episode of ours, for theirs to play.

    Attributes:
        level: what it was played on.
        course: what happened.
        deciding: the trains that decide, a list a step.
        orders: what 4.3.0 is told to do, a step.
    """

    level: Level
    course: Course
    deciding: list[list[int]]
    orders: list[_Orders]


def script_of(level: Level, course: Course) -> Script:
    """What 4.3.0 must be told to play an episode again."""
    deciding: list[list[int]] = [[] for _ in range(course.last_step)]
    actions = np.full((course.last_step, level.n_trains), MOVE_FORWARD)
    decisions = course.decisions
    for step, train, action in zip(decisions.times, decisions.trains, decisions.actions, strict=True):
        deciding[step].append(int(train))
        actions[step, train] = action
    driver = LegacyActions(LevelEnv(level))
    return Script(level, course, deciding, [driver.step(chosen) for chosen in actions.tolist()])


class TheirPlayer:
    """A plain loop over the library and torch."""

    def __init__(self, network: QNetwork) -> None:
        self._network = network
        self._random = random.Random(0)

    def play(self, script: Script) -> tuple[float, float]:
        """Seconds of the reset, and of all steps.

        Raises:
            DisagreementError: some reward is another than in the script.
        """
        env = study_environment(script.level)
        resetting, (seen, _) = timed(env.reset)
        playing, rewards = timed(lambda: self._loop(env, seen, script))
        forget_rails()
        if not env.dones["__all__"] or not _same(rewards, script.course.rewards):
            raise DisagreementError("an episode went another way in flatland-rl")
        return resetting, playing

    def _loop(self, env: Any, seen: dict[int, Any], script: Script) -> list[dict[int, float]]:
        """Returns the rewards."""
        rewards = []
        for deciding, orders in zip(script.deciding, script.orders, strict=True):
            if deciding:
                choose(self._network, observed([seen[train] for train in deciding]), EPSILON, self._random)
            seen, gained, _, _ = env.step(orders)
            rewards.append(gained)
        return rewards


def study_environment(level: Level) -> Any:
    """The library's environment on a level, with the study's rewards and start, and its own trees."""
    return plain_environment(
        level,
        TreeObsForRailEnv(DEPTH),
        rewards=StudyRewards(),
        effects_generator=StartReady(),
        acceleration_delta=Fraction(1),  # the default, a float, is converted in every step
        braking_delta=Fraction(-1),
        random_seed=0,
    )


def choose(network: QNetwork, observations: NDArray[np.float32], epsilon: float, chance: random.Random) -> list[int]:
    """[B]: an action for each of the observations [B, F], epsilon-greedily, by one forward pass."""
    with torch.no_grad():
        best = network(torch.from_numpy(observations)).argmax(dim=1).tolist()
    return [chance.randrange(N_ACTIONS) if chance.random() < epsilon else action for action in best]


def observed(trees: Sequence[Any]) -> NDArray[np.float32]:
    """[B, F]: trees of the library as a network sees them."""
    return np.stack([normalise(flattened(tree)) for tree in trees])


def flattened(tree: Any) -> NDArray[np.float64]:
    """[21, 12]: the features of a tree of the library, NaN where there is no node."""
    nodes = np.full((N_NODES, N_NODE_FEATURES), np.nan)
    _flatten(tree, nodes, 0, N_NODES)
    return nodes


def _flatten(node: Any, nodes: NDArray[np.float64], at: int, size: int) -> None:
    nodes[at] = node[:N_NODE_FEATURES]
    below = (size - 1) // 4
    for turn, child in enumerate(node.childs.values()):
        if isinstance(child, tuple):  # else there is no way
            _flatten(child, nodes, at + 1 + turn * below, below)


def _same(theirs: Sequence[dict[int, float]], ours: NDArray[np.float32]) -> bool:
    return len(theirs) == len(ours) and all(
        list(there.values()) == here.tolist() for there, here in zip(theirs, ours, strict=True)
    )


def comparison(
    name: str, levels: Sequence[Level], observation: str = "tree", interlocking: Interlocking = "off"
) -> Comparison:
    """Play an episode of each level; every repeat explores in another way."""
    rollouts, they = study_rollouts(OBSERVATIONS[observation], interlocking), TheirPlayer(pathfinder())
    network = pathfinder(observation)
    twin = Twin(network_layout(NETWORK, network.n_features))
    twin.load(export_parameters(network))

    def play_all(keys: Sequence[int]) -> list[Course]:
        for _ in range(PASSES):
            courses = [
                play(rollouts, *one) for one in zip(levels, (Acting(twin, EPSILON, key) for key in keys), strict=True)
            ]
        return courses

    def once(repeat: int) -> list[Sample]:
        keys = [stream_key(repeat, number, "explore") for number in range(len(levels))]
        seconds, courses = timed(lambda: play_all(keys))
        ours = seconds / PASSES
        resetting, playing = np.sum(
            [they.play(script_of(*one)) for one in zip(levels, courses, strict=True)], axis=0
        ).tolist()
        per_step = 1e6 / sum(course.last_step for course in courses)
        per_episode = 1e3 / len(levels)
        return [
            Sample(f"step with policy {name}", "us/step", ours * per_step, playing * per_step),
            Sample(
                f"episode with policy {name}", "ms/episode", ours * per_episode, (resetting + playing) * per_episode
            ),
        ]

    return Comparison(f"policy {name}", once)


def comparisons(worlds: int, observation: str = "tree", interlocking: Interlocking = "off") -> list[Comparison]:
    """All that is measured: episodes on so many levels of each difficulty."""
    torch.set_num_threads(1)
    return [
        comparison(name, [generate(name, seed) for seed in range(worlds)], observation, interlocking)
        for name in shipped()
    ]


if __name__ == "__main__":
    run(
        "Compare whole episodes with a policy with flatland-rl and torch.",
        comparisons,
        worlds=8,
        observation=tuple(OBSERVATIONS),
        interlocking=get_args(Interlocking),
    )
