"""python -m railctl.services.evaluator.demonstrate REQUEST: writes training episodes that a policy plays.

How it answers: see `common.task`. An episode is played on the level on which a run of the same configuration acts its
episode of that number, under the same conditions; see `common.demonstrations` for the file.
"""

from collections.abc import Iterator

import numpy as np

from railctl.common.checkpoint import CheckpointError
from railctl.common.config import RunConfig, parse_config
from railctl.common.demonstrations import write_demonstrations
from railctl.common.levels.chunks import BankError
from railctl.common.levels.level import Level
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.checkpoints import load_policy
from railctl.common.policy.compiled import Twin
from railctl.common.policy.player import Acting, compiled_world, play, player
from railctl.common.records.course import Course
from railctl.common.requests import PLANNING, DemonstrationRequest, asked
from railctl.common.seeding import stream_key, training_distribution, training_level_seed, training_malfunction_seed
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say
from railctl.services.evaluator.references.demonstrating import Play, demonstrator
from railctl.services.evaluator.runner import UnplayableLevelError


def demonstrate(request: DemonstrationRequest) -> None:
    """Play all episodes, and say what became of them."""
    config = parse_config(request.config)
    policy = Demonstrating(request, config)
    returns, arrived, decisions = [], [], 0

    def courses() -> Iterator[Course]:
        nonlocal decisions
        levels = LevelSupply(config.world.levels, request.bank, base=request.base)
        teller = Teller("episodes")
        teller.tell(0, request.episodes)
        for episode in range(request.episodes):
            name = training_distribution({str(key): share for key, share in config.mix.items()}, config.seed, episode)
            level = levels.training(name, training_level_seed(config.seed, episode))
            course = policy.play(name, episode, level)
            returns.append(course.normalised_return)
            arrived.append(float((course.arrived_at >= 0).mean()))
            decisions += len(course.decisions)
            teller.tell(episode + 1, request.episodes)
            yield course

    write_demonstrations(request.file, config.world, policy.told, request.episodes, courses())
    say(
        {
            "file": str(request.file),
            "policy": policy.told,
            "episodes": request.episodes,
            "decisions": decisions,
            "mean": float(np.mean(returns)),
            "arrived_share": float(np.mean(arrived)),
        }
    )


class Demonstrating:
    """Whoever plays, on the levels of a run.

    Attributes:
        told: who it is, in words.
    """

    def __init__(self, request: DemonstrationRequest, config: RunConfig) -> None:
        """Raises ConfigError if the policy cannot play in the run's world."""
        self._request, self._config = request, config
        self._players: dict[str, Play] = {}
        if request.policy is not None:
            _check_world(request.policy, config)
            orders = f", the best of {request.orders} orders" if request.policy in PLANNING else ""
            self.told = f"{request.policy}{orders}"
            return
        if request.checkpoint is None:
            raise ConfigError("policy and checkpoint are missing: give one of them")
        self._saved = load_policy(request.checkpoint)
        theirs, ours = self._saved.config.world, config.world
        if (theirs.observation, theirs.n_features) != (ours.observation, ours.n_features):
            raise ConfigError(
                f"{request.checkpoint}: its trains see {theirs.n_features} features ({theirs.observation.kind}), those "
                f"of the run {ours.n_features} ({ours.observation.kind}): give the run its observation"
            )
        self._mode = request.mode or self._saved.config.evaluation.mode
        if self._mode == "sample" and not self._saved.config.learning.has_probabilities:
            raise ConfigError(
                f"--sample: {self._saved.config.algorithm} learns action values, which are no probabilities to draw "
                "from: leave it out"
            )
        self.told = f"{self._saved.config.algorithm} after {self._saved.episode} episodes, {self._mode}"

    def play(self, name: str, episode: int, level: Level) -> Course:
        """An episode on a level of a distribution.

        Raises:
            UnplayableLevelError: the policy, or the world, cannot play it.
        """
        if name not in self._players:
            self._players[name] = self._player(name)
        try:
            return self._players[name](episode, level, training_malfunction_seed(self._config.seed, episode))
        except (ValueError, MemoryError) as error:
            raise UnplayableLevelError(f"episode {episode}, on {name}: {error}") from error

    def _player(self, name: str) -> Play:
        world, request, seed = self._config.world, self._request, self._config.seed
        rules, trains = world.levels[name].rules, world.levels[name].bounds.trains
        if request.policy is not None:
            return demonstrator(request.policy, compiled_world(world, rules, trains), seed, request.orders)
        network, greedy = self._saved.network, self._mode == "greedy"
        playing = player("compiled", world, rules, trains, has_twin=isinstance(network, Twin))

        def with_network(episode: int, level: Level, malfunction_seed: int) -> Course:
            key = stream_key(seed, episode, "demonstrate")
            return play(playing, level, Acting(network, key=key, greedy=greedy), malfunction_seed)

        return with_network


def _check_world(policy: str, config: RunConfig) -> None:
    """Raise ConfigError if a policy would not be itself behind the run's interlocking."""
    mode = config.world.interlocking
    if policy == "planner" and mode != "off":
        raise ConfigError(
            f"planner: an interlocking ({mode}) may forbid what it has planned: take planner-replanned, or add "
            "--set interlocking=off"
        )
    if policy == "shortest-path-planned" and mode != "planned":
        raise ConfigError(
            f"shortest-path-planned: it goes as an interlocking allows, here {mode}: add --set interlocking=planned"
        )


def main() -> None:
    carry_out(lambda: demonstrate(asked(DemonstrationRequest)), CheckpointError, BankError, UnplayableLevelError)


if __name__ == "__main__":
    main()
