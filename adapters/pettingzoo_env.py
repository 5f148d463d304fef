"""Any world of a run file as a PettingZoo `ParallelEnv`: the compiled world, the training levels, an agent a train.

Source of the interface: "PettingZoo: Gym for Multi-Agent Reinforcement Learning", Terry et al. (2021,
arXiv:2009.14471). Observations and rewards are those of the world, actions flatland's.

Trains decide at few steps only (`decisions`). All others get an observation, too, but their actions do not count:
`infos[agent]["deciding"]` says so, and `infos[agent]["action_mask"]` leaves them MOVE_FORWARD alone. To those that
decide it leaves what the world's interlocking would allow them if they were asked first. Agents act at once, but
trains are asked in turn: who is not granted its action stops, and `infos[agent]["refused"]` says so after the step.

The study gives 1 to all trains on the step on which the last one arrives. Those that arrived before are no agents any
more: `infos[agent]["team_reward"]` is the sum over all trains. On the last step `infos[agent]["normalised_return"]` is
what the study reports of the episode, whatever is learned from, and under stock rules `infos[agent]["score"]` is the
score of flatland-rl 4.3.0.
"""

import operator
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from railctl.adapters.granting import FORWARD_ONLY, MASKS, grant_all
from railctl.adapters.settings import setting_of
from railctl.common.levels.distributions import Rules
from railctl.common.levels.level import Level
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.player import compiled_world
from railctl.common.rail.compiled.world import CompiledWorld
from railctl.common.rail.observations.table import look
from railctl.common.rail.world import MOVE_FORWARD, N_ACTIONS
from railctl.common.records.course import NONE, normalised_return
from railctl.common.seeding import training_distribution, training_level_seed, training_malfunction_seed
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.common.world import Decisions, WorldSpec

Observation = NDArray[np.float32]
Infos = dict[str, dict[str, Any]]
Actions = Mapping[str, int | np.int64]
Outcome = tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]
RENDER_MODES = ["human", "rgb_array"]
SEED_BITS = 31
OPTIONS = {"levels", "difficulty", "level"}  # of `reset`


class TrainsEnv(ParallelEnv[str, Observation, np.int64]):
    """Agents `train_0`, `train_1`, ...; one that has arrived terminates, the step limit truncates the others.

    After `reset(seed=s)` an episode is on the level, with the malfunctions, of the first episode of a run of seed s and
    of the same levels; each `reset()` then goes on to the next. A seed is drawn if none was ever given.

    Attributes:
        world: what is played.
        level: the level that is being played.
    """

    metadata = {  # noqa: RUF012  (the interface's own form)
        "name": "railctl_trains_v0",
        "render_modes": RENDER_MODES,
        "render_fps": 5,
    }

    def __init__(  # noqa: PLR0913
        self,
        name: str | None = None,
        *,
        run_file: Path | str | None = None,
        world: WorldSpec | None = None,
        depth: int | None = None,
        decisions: Decisions | None = None,
        levels: LevelSupply | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make an environment; it starts with `reset`.

        Args:
            name: of the level distribution, unless `reset` asks for another. If not given: `easy`, the mix of the run
                file, or all of the world's with equal shares.
            run_file: as `railctl up -f` takes it: its world and its mix count.
            world: what is played, instead of a run file; with neither, the study's world.
            depth: of the trees of the study's world, 1 to 3: 60, 252 or 1020 features.
            decisions: where trains of the study's world decide, `cells`, `legacy` or `always`.
            levels: where levels come from; the generators and the run file's level files if not given.
            render_mode: `rgb_array` or `human`, see `render`.

        Raises:
            ValueError: an argument is none of these, or they contradict each other.
            NoDisplayError: `human`, and there is no display.
        """
        setting = setting_of(run_file, world, depth, decisions)
        self._setting = setting if name is None else setting.only(name)
        self.world = setting.world
        self.possible_agents = [f"train_{train}" for train in range(self._setting.most_trains)]
        self.agents: list[str] = []
        self.level: Level | None = None
        self._levels = LevelSupply(self.world.levels, base=setting.base) if levels is None else levels
        self._numbers = {agent: train for train, agent in enumerate(self.possible_agents)}
        observation = self.world.observation
        box = Box(observation.low, observation.high, (self.world.n_features,), np.float32)
        self.observation_spaces: dict[str, Space[Any]] = dict.fromkeys(self.possible_agents, box)
        self.action_spaces: dict[str, Space[Any]] = {agent: Discrete(N_ACTIONS) for agent in self.possible_agents}
        self._worlds: dict[Rules, CompiledWorld] = {}
        self._played: CompiledWorld | None = None
        self._arrived_at = np.zeros(0, np.int32)
        self._step = 0
        self._seed: int | None = None
        self._episode = 0
        self.render_mode = _render_mode(render_mode)
        self._canvas: Any = None
        self._window: Any = _window(self.metadata) if render_mode == "human" else None

    def observation_space(self, agent: str) -> Space[Observation]:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[np.int64]:
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], Infos]:
        """Start an episode.

        Args:
            seed: see the class.
            options: `levels`, the name of the distribution of this level (`difficulty` says the same), or `level`, to
                be played instead of a drawn one: under the rules of the environment's levels, or, if there are both
                among them, stock rules if it has a schedule. Others are for wrappers, and warned of here.

        Returns:
            Observations and infos of all agents.

        Raises:
            ValueError: the seed is none, or the level is none, has more trains than there can be agents, or does not
                fit the world.
        """
        if seed is not None:
            self._seed, self._episode = _seed(seed), 0
        elif self._seed is None:
            self._seed = secrets.randbits(SEED_BITS)
        else:
            self._episode += 1
        for option in (options or {}).keys() - OPTIONS:
            logger.warn(f"reset knows no option {shortened(option)}: known are {', '.join(sorted(OPTIONS))}")
        level, rules = self._drawn(self._seed, options or {})
        if level.n_trains > len(self.possible_agents):
            raise ValueError(
                f"a level with {level.n_trains} trains, but an environment for {len(self.possible_agents)}: "
                "make it for levels with more trains"
            )
        played = self._world_of(rules)
        played.load(0, level, training_malfunction_seed(self._seed, self._episode))
        self._played, self.level, self._canvas, self._step = played, level, None, 0
        self._arrived_at = np.full(level.n_trains, NONE, np.int32)
        self.agents = self.possible_agents[: level.n_trains]
        self._show()
        return self._observations(played), self._infos(played, 0.0, set())

    def step(self, actions: Actions) -> Outcome:
        """One step of all trains.

        Args:
            actions: of the agents; those that do not decide may be left out.

        Returns:
            Observations, rewards, terminations, truncations and infos of those that were agents before the step. An
            arrived train sees nothing: zeros. After the last step there are no agents, so all five are empty.

        Raises:
            ResetNeeded: there was no episode yet, or it is over and there are actions.
            ValueError: this is no dictionary, an action is none, or that of a train that decides is missing.
        """
        if not isinstance(actions, Mapping):
            raise ConfigError(f"actions {shortened(actions)}: give a dictionary, an action by agent")
        played = self._played
        if played is None or (actions and not self.agents):
            raise ResetNeeded("there is no episode to step: call reset first")
        if not self.agents:
            return {}, {}, {}, {}, {}
        wanted = self._given(played, actions)
        refused = grant_all(played, wanted)
        rewards = played.step(wanted)[0]
        arrived, over = played.arrived()[0], bool(played.over()[0])
        self._arrived_at[arrived[: len(self._arrived_at)] & (self._arrived_at == NONE)] = self._step
        self._step += 1
        before = self.agents
        terminated = {agent: bool(arrived[self._numbers[agent]]) for agent in before}
        truncated = {agent: over and not terminated[agent] for agent in before}
        given = {agent: float(rewards[self._numbers[agent]]) for agent in before}
        observations, infos = self._observations(played), self._infos(played, float(rewards.sum()), refused)
        self.agents = [agent for agent in before if not (terminated[agent] or truncated[agent])]
        self._show()
        return observations, given, terminated, truncated, infos

    def render(self) -> NDArray[np.uint8] | None:
        """What is going on: [H, W, 3] if the mode is `rgb_array`, in a window and None if it is `human`.

        In a window every step shows by itself.

        Raises:
            ResetNeeded: there is no episode.
        """
        if self.render_mode is None:
            logger.warn("there is nothing to render to: make the environment with render_mode rgb_array or human")
            return None
        picture = self._picture()
        if self._window is None:
            return picture
        self._window.show(picture)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def _world_of(self, rules: Rules) -> CompiledWorld:
        if rules not in self._worlds:
            self._worlds[rules] = compiled_world(self.world, rules, len(self.possible_agents))
        return self._worlds[rules]

    def _drawn(self, seed: int, options: dict[str, Any]) -> tuple[Level, Rules]:
        level = options.get("level")
        if level is not None:
            if not isinstance(level, Level):
                raise ValueError(f"level {shortened(level)} is no Level; ask for one by name with levels")
            known = {self.world.levels[name].rules for name in self._setting.mix}
            both: Rules = "legacy" if level.schedule is None else "stock"
            return level, both if len(known) > 1 else known.pop()
        asked = options.get("levels", options.get("difficulty"))
        mix = self._setting.mix if asked is None else self._setting.only(asked).mix
        name = training_distribution(mix, seed, self._episode)
        return self._levels.training(name, training_level_seed(seed, self._episode)), self.world.levels[name].rules

    def _given(self, played: CompiledWorld, actions: Actions) -> NDArray[np.int8]:
        """[1, N]: the actions of all trains."""
        for agent in actions:
            if agent not in self._numbers:
                raise ValueError(f"there is no agent {shortened(agent)}{nearest(str(agent), self.agents)}")
        given = np.full((1, len(self.possible_agents)), MOVE_FORWARD, np.int8)
        deciding = played.deciding()[0]
        for agent in self.agents:
            train = self._numbers[agent]
            action = actions.get(agent)
            if action is None:
                if deciding[train]:
                    raise ValueError(f"{agent} decides, and there is no action for it")
            elif not 0 <= (number := _whole(action)) < N_ACTIONS:
                raise ValueError(f"{agent} has action {shortened(action)}: choose 0 to {N_ACTIONS - 1}")
            else:
                given[0, train] = number
        return given

    def _observations(self, played: CompiledWorld) -> dict[str, Observation]:
        """What all agents see, in one call."""
        arrived = played.arrived()[0]
        seeing = [agent for agent in self.agents if not arrived[self._numbers[agent]]]
        asking = np.zeros((1, played.max_trains), np.bool_)
        asking[0, [self._numbers[agent] for agent in seeing]] = True
        vectors = np.empty((len(seeing), played.n_features), np.float32)
        parts = played.parts()
        look(parts.batch, parts.sight, parts.observation, asking, vectors)
        seen = dict(zip(seeing, vectors, strict=True))
        return {agent: seen.get(agent, np.zeros(played.n_features, np.float32)) for agent in self.agents}

    def _infos(self, played: CompiledWorld, team_reward: float, refused: set[int]) -> Infos:
        deciding, allowed = played.deciding()[0], played.allowed(0)
        common = {"team_reward": team_reward, **self._results(played)}
        infos: Infos = {}
        for agent in self.agents:
            train = self._numbers[agent]
            mask = MASKS[allowed[train]] if deciding[train] else FORWARD_ONLY
            own = {"deciding": bool(deciding[train]), "action_mask": mask, "refused": train in refused}
            infos[agent] = own | common
        return infos

    def _results(self, played: CompiledWorld) -> dict[str, float]:
        """What is reported of an episode that is over."""
        if self.level is None or not played.over()[0]:
            return {}
        score = played.score(0)
        results = {"normalised_return": normalised_return(self._arrived_at, self._step, self.level.max_steps)}
        return results if np.isnan(score) else results | {"score": score}

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self._picture())

    def _picture(self) -> NDArray[np.uint8]:
        from railctl.adapters.pictures import trains_of  # noqa: PLC0415  (who trains draws nothing)
        from railctl.common.pictures.canvas import Canvas  # noqa: PLC0415

        if self.level is None or self._played is None:
            raise ResetNeeded("there is no episode to render: call reset first")
        if self._canvas is None:
            self._canvas = Canvas(self.level)
        picture: NDArray[np.uint8] = self._canvas.picture(trains_of(self._played))
        return picture


def _whole(value: Any) -> int:
    """A whole number of any library; -1 for what is none, which is no action and no seed."""
    try:
        return -1 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        return -1


def _seed(seed: Any) -> int:
    number = _whole(seed)
    if not 0 <= number < 1 << SEED_BITS:
        raise ValueError(f"seed {shortened(seed)}: give a whole number from 0 to 2**{SEED_BITS} - 1")
    return number


def _render_mode(mode: str | None) -> str | None:
    if mode is not None and mode not in RENDER_MODES:
        raise ConfigError(f"unknown render_mode {shortened(mode)}{nearest(mode, RENDER_MODES)}")
    return mode


def _window(metadata: Mapping[str, Any]) -> Any:
    from railctl.adapters.windows import Window  # noqa: PLC0415  (matplotlib takes a second)

    return Window("railctl", metadata["render_fps"])
