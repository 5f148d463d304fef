"""Playing episodes: a level and choices in, courses out; an episode whole, or one fragment after the other."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.planning.judging import Teacher
from railctl.common.rail.world import MOVE_FORWARD, World
from railctl.common.records.course import NONE, Course, Decisions


class Decision(NamedTuple):
    """What a train does, and for policies with what log-probability and expecting which value."""

    action: int
    log_probability: float = 0.0
    value: float = 0.0


# By observation [F], step and train; then, unless it is all and nothing, what is allowed, and what a teacher would do:
Choose = Callable[..., Decision]


class Stage:
    """A world of one slot, of any engine, that plays one episode at a time. `on_step` is called before every step."""

    def __init__(self, world: World, on_step: Callable[[], None] = lambda: None) -> None:
        self._world = world
        self._on_step = on_step
        self._level: Level | None = None
        self._step = 0
        self._arrived_at = np.zeros(0, np.int32)

    def begin(self, level: Level, malfunction_seed: int, actions: NDArray[np.int8], steps: int) -> None:
        """Start an episode and take its first `steps`, with the `actions` of all decisions in them.

        Raises:
            ValueError: there are more or fewer decisions than actions.
        """
        self._world.load(0, level, malfunction_seed)
        self._level, self._step = level, 0
        self._arrived_at = np.full(level.n_trains, NONE, np.int32)
        given = iter(actions.tolist())
        try:
            for _ in range(steps):
                self._take({train: next(given) for train in self._deciding()})
        except StopIteration:
            given = iter([NONE])
        if next(given, None) is not None:
            raise ValueError(f"{len(actions)} actions do not fit the first {steps} steps of this level")

    def advance(
        self,
        choose: Choose,
        states: NDArray[np.float32],
        steps: int | None = None,
        teacher: Teacher | None = None,
        *,
        following: bool = False,
    ) -> Course:
        """Play on, to the end or for at most `steps`; `states` [N, S] are those that `choose` changes.

        Decisions are noted with what their trains see one step later if this `following` is wanted.
        """
        level, first_step = self._level, self._step
        if level is None:
            raise ValueError("nothing to advance: begin an episode first")
        last_step = level.max_steps if steps is None else first_step + steps
        observations, marks, allowed, chosen, labels, rewards, later = [], [], [], [], [], [], []
        while self._step < last_step and not self._world.over()[0]:
            seen = {train: self._world.observe(0, train) for train in self._deciding()}
            made = self._ask(choose, seen, teacher)
            for train, observation in seen.items():
                bits, label, decision = made[train]
                observations.append(observation)
                marks.append((self._step, train))
                allowed.append(bits)
                chosen.append(decision)
                labels.append(label)
            rewards.append(self._take({train: decision.action for train, (*_, decision) in made.items()}))
            if following:
                later += [self._sight(train) for train in seen]
        count = len(chosen)
        times, trains = np.array(marks, np.int32).reshape(count, 2).T.copy()
        taken = np.array(chosen).reshape(count, 3).T
        decisions = Decisions(
            observations=np.array(observations, np.float32).reshape(count, self._world.n_features),
            times=times,
            trains=trains,
            actions=taken[0].astype(np.int8),
            allowed=np.array(allowed, np.uint8),
            log_probabilities=taken[1].astype(np.float32),
            values=taken[2].astype(np.float32),
            labels=np.array(labels, np.int8),
            following=np.array(later, np.float32).reshape(count, self._world.n_features if following else 0),
        )
        return Course(
            level_hash=level.content_hash,
            max_steps=level.max_steps,
            first_step=first_step,
            over=bool(self._world.over()[0]),
            decisions=decisions,
            rewards=np.array(rewards, np.float32).reshape(-1, level.n_trains),
            arrived_at=self._arrived_at.copy(),
            final_observations=self._look_back(),
            final_allowed=self._allowed_at_end(),
            states=states.copy(),
            score=self._score(),
        )

    def _deciding(self) -> list[int]:
        trains: list[int] = np.flatnonzero(self._world.deciding()[0]).tolist()
        return trains

    def _ask(
        self, choose: Choose, seen: dict[int, NDArray[np.float32]], teacher: Teacher | None
    ) -> dict[int, tuple[int, int, Decision]]:
        """What the deciding trains, which see these observations, are allowed, should do and do, asked in turn."""
        made, asking = {}, self._world.ask(0)
        for train, allowed in asking:
            label = NONE if teacher is None else self._world.advise(0, train, allowed, teacher)
            decision = choose(seen[train], self._step, train, allowed, label)
            asking.grant(train, decision.action)
            made[train] = allowed, label, decision
        return made

    def _take(self, chosen: dict[int, int]) -> NDArray[np.float32]:
        self._on_step()
        actions = np.full((self._world.slots, self._world.max_trains), MOVE_FORWARD, np.int8)
        for train, action in chosen.items():
            actions[0, train] = action
        n_trains = len(self._arrived_at)
        rewards = self._world.step(actions)[0, :n_trains].copy()
        self._arrived_at[self._world.arrived()[0, :n_trains] & (self._arrived_at == NONE)] = self._step
        self._step += 1
        return rewards

    def _score(self) -> float | None:
        score = self._world.score(0) if self._world.over()[0] else np.nan
        return None if np.isnan(score) else float(score)

    def _sight(self, train: int) -> NDArray[np.float32]:
        """What a train sees; zeros once it has arrived."""
        arrived = self._arrived_at[train] != NONE
        return np.zeros(self._world.n_features, np.float32) if arrived else self._world.observe(0, train)

    def _look_back(self) -> NDArray[np.float32]:
        n_trains = len(self._arrived_at)
        if self._world.over()[0]:
            return np.array([self._sight(train) for train in range(n_trains)])
        return np.zeros((n_trains, self._world.n_features), np.float32)

    def _allowed_at_end(self) -> NDArray[np.uint8]:
        n_trains = len(self._arrived_at)
        if self._world.over()[0]:
            return self._world.allowed(0)[:n_trains]
        return np.full(n_trains, ALL_ACTIONS, np.uint8)
