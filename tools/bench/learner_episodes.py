"""What a learner does when an episode comes: a part of `railctl bench learner`.

A row a rule, and `ppo` on episodes of other sizes. Ours is the trainer that a run has, with all there is around its
updates: transitions or returns, the replay, drawing from it, metrics. Theirs is the same trainer over a module of torch
and autograd. The episodes are made up, of observations that the study's levels give. Metrics must agree, but for
`drqn`'s: torch's LSTM has no sequences that begin late.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.networks import build_network
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.normalise import N_FEATURES
from railctl.common.rail.world import N_ACTIONS
from railctl.common.records.acting import Circumstances, Fragment, Lease
from railctl.common.records.course import Course, Decisions
from railctl.common.rules import settings_of
from railctl.services.learner.algorithms.drqn import sequences
from railctl.services.learner.learning import Learning, Trainer, build_trainer
from railctl.services.learner.textbook.dqn import Dqn
from railctl.services.learner.training import ValueTrainer
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, timed

TRAINS, EVERY = 5, 4  # each train decides on every fourth step
BEFORE, EPISODES = 5, 4  # trained on before the clock runs, and then
TOLERANCE = 1e-2  # of metrics, which some twenty updates lie before
VALUES = {"learning_rate": 3e-4, "batch_size": 150, "learn_every_steps": 30, "target_tau": 0.05}
POLICIES = {"learning_rate": 5e-4, "epochs": 10}
RULES: dict[str, tuple[str, dict[str, Any]]] = {  # by preset: the rule and its settings
    "dqn": ("dqn", {"network": {"kind": "plain"}, "dqn": VALUES | {"batch_size": 128, "target_tau": None}}),
    "ddqn": ("dqn", {"network": {"kind": "plain"}, "dqn": VALUES}),
    "dddqn": ("dqn", {"network": {"kind": "dueling"}, "dqn": VALUES}),
    "drqn": ("drqn", {"dqn": VALUES}),
    "ppo": ("ppo", {"ppo": POLICIES}),
    "ppor": ("ppor", {"ppo": POLICIES | {"batch_size": 300}, "replay": {"kind": "uniform", "capacity": 10_000}}),
    "sil": (
        "sil",
        {
            "ppo": POLICIES,
            "sil": {"epochs": 10, "batch_size": 300},
            "replay": {"kind": "prioritized", "capacity": 20_000, "beta": 0},
        },
    ),
}
SIZES: dict[str, tuple[int, ...]] = dict.fromkeys(RULES, (85,)) | {"ppo": (60, 85, 120, 300, 1200)}


class Disguised(nn.Module):
    """A network that no compiled code knows."""

    def __init__(self, inner: nn.Module) -> None:
        super().__init__()
        self.inner, self.n_features = inner, N_FEATURES

    def forward(self, observation: Tensor) -> Any:
        return self.inner(observation)


def learning(rule: str, sections: dict[str, Any]) -> Learning[Any]:
    """A run's."""
    replay = {"replay": {"kind": "uniform", "capacity": 50_000}} if "dqn" in sections else {}
    return Learning(1, 1500, settings_of(rule).model_validate(replay | sections), N_FEATURES, N_ACTIONS)


def by_torch(rule: str, own: Learning[Any]) -> Trainer:
    """The trainer of a rule over a module of torch."""
    settings = own.settings
    sizes = settings.network, N_FEATURES, N_ACTIONS, own.seed
    if rule == "drqn":
        look = partial(sequences, length=settings.dqn.sequence_decisions)
        return ValueTrainer(own, Dqn(settings.dqn, build_recurrent_network(*sizes)), look)
    network = build_network(*sizes) if rule == "dqn" else build_actor_critic(*sizes)
    kind = type("Disguised", (type(settings),), {"module": lambda *_: Disguised(network)})
    return build_trainer(rule, Learning(own.seed, own.episodes, kind(**dict(settings)), N_FEATURES, N_ACTIONS))


def episode(number: int, rows: NDArray[np.float32], decisions: int) -> Fragment:
    """One of so many decisions, whose observations are drawn from `rows`; no train arrives."""
    rng, times = np.random.default_rng(number), EVERY * (np.arange(decisions, dtype=np.int32) // TRAINS)
    steps = EVERY * -(-decisions // TRAINS)
    course = Course(
        level_hash="0" * 32,
        max_steps=steps,
        first_step=0,
        over=True,
        decisions=Decisions(
            observations=rows[rng.integers(len(rows), size=decisions)],
            times=times,
            trains=np.arange(decisions, dtype=np.int32) % TRAINS,
            actions=rng.integers(N_ACTIONS, size=decisions).astype(np.int8),
            allowed=np.full(decisions, ALL_ACTIONS, np.uint8),
            labels=np.full(decisions, -1, np.int8),
            following=np.zeros((decisions, 0), np.float32),
            log_probabilities=np.full(decisions, -np.log(N_ACTIONS), np.float32),
            values=-rng.random(decisions, np.float32),
        ),
        rewards=np.full((steps, TRAINS), -1, np.float32),
        arrived_at=np.full(TRAINS, -1, np.int32),
        final_observations=rows[rng.integers(len(rows), size=TRAINS)],
        final_allowed=np.full(TRAINS, ALL_ACTIONS, np.uint8),
        states=np.zeros((TRAINS, 0), np.float32),
    )
    lease = Lease(
        episode=number,
        level="easy",
        level_seed=number,
        weights_version=number,
        epsilon=0.0,
        steps=None,
        progressed=None,
    )
    return Fragment(lease=lease, course=course, circumstances=Circumstances(actor="bench", acting_s=0, waited_s=0))


def episode_comparison(name: str, decisions: int, rows: NDArray[np.float32]) -> Comparison:
    """Training on whole episodes."""
    rule, sections = RULES[name]
    title = f"{name} episode, {decisions} decisions"

    def once(_repeat: int) -> Sequence[Sample]:
        episodes = [episode(number, rows, decisions) for number in range(BEFORE + EPISODES)]
        own = learning(rule, sections)
        times, told = [], []
        for trainer in (build_trainer(rule, own), by_torch(rule, own)):
            for before in episodes[:BEFORE]:
                trainer.train(before)
            seconds, metrics = timed(partial(_train, trainer, episodes[BEFORE:]))
            times.append(seconds * 1e6 / EPISODES)
            told.append(metrics)
        ours, theirs = told
        if not agree(ours, theirs, ("updates", "transitions") if rule == "drqn" else tuple(ours)):
            raise DisagreementError(f"{title}: metrics are {ours} and {theirs}")
        return [Sample(title, "us/episode", *times)]

    return Comparison(title, once)


def _train(trainer: Trainer, episodes: Sequence[Fragment]) -> dict[str, float]:
    return [trainer.train(one) for one in episodes][-1]


def agree(ours: dict[str, float], theirs: dict[str, float], names: Sequence[str]) -> bool:
    """Whether these metrics are about the same."""
    return all(np.isclose(ours[name], theirs[name], rtol=TOLERANCE, atol=TOLERANCE) for name in names)


def episode_comparisons(rows: NDArray[np.float32]) -> list[Comparison]:
    """All of them; observations are drawn from `rows`."""
    return [episode_comparison(name, decisions, rows) for name, sizes in SIZES.items() for decisions in sizes]
