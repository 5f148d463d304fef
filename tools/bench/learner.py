"""How much faster updates are than plain torch: `railctl bench learner`.

Both get the same batches, of observations as the study's levels give them, and start from the same network; all their
losses must agree. Theirs is what a textbook writes: modules, autograd, `torch.optim.Adam` as it comes,
one thread. Neither pays for drawing from the replay; ours pays for finding the zeros of its observations. Episodes of
the study have 60 to 300 decisions, on which `ppo` makes ten updates in one call.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from railctl.common.levels.shipped import generate
from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.first_weights import first_actor_critic, first_recurrent, first_values
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.packing import Kind, Layout
from railctl.common.policy.player import Acting, play
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.normalise import N_FEATURES
from railctl.common.rail.world import N_ACTIONS
from railctl.common.rules.policies import PpoConfig
from railctl.common.rules.settings import NetworkConfig
from railctl.common.rules.sil import SilConfig
from railctl.common.rules.values import DqnConfig
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.algorithms.sil import Sil
from railctl.services.learner.experience import Experience
from railctl.services.learner.fused.dqn import FusedDqn
from railctl.services.learner.fused.drqn import FusedDrqn
from railctl.services.learner.fused.policy import FusedPolicy
from railctl.services.learner.sparse import SparseRows, sparse_rows
from railctl.services.learner.textbook.plain_dqn import PlainDqn
from railctl.services.learner.textbook.plain_policy import PlainPolicy
from railctl.services.learner.training import Batch, ValueMethod
from railctl.tools.bench.conditions import study_rollouts
from railctl.tools.bench.learner_episodes import episode_comparisons
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, run, timed

HIDDEN = (128, 128)
LEVELS, EPSILON = 8, 0.5  # played for their observations
SEQUENCE = 8
TOLERANCE = 1e-3  # of losses; rounding alone once in a while switches a hidden unit on, which shows in the fifth digit


Learn = Callable[[Any], float]  # learns from a batch; returns the loss of its last update


class Case(NamedTuple):
    """What to measure: `sides` makes ours and theirs anew, `batch` draws what both make `epochs` updates on."""

    name: str
    sides: Callable[[], tuple[Learn, Learn]]
    batch: Callable[["Seen", np.random.Generator], Any]
    epochs: int = 1


class Seen:
    """Observations of real episodes."""

    def __init__(self) -> None:
        twin, rollouts = Twin(Layout("plain", N_FEATURES, N_ACTIONS, HIDDEN)), study_rollouts()
        twin.load(export_parameters(build_network(NetworkConfig(hidden=HIDDEN), N_FEATURES, N_ACTIONS, 1)))
        played = [play(rollouts, generate("easy", seed), Acting(twin, EPSILON, seed)) for seed in range(LEVELS)]
        self.rows = np.array([row for course in played for row in course.decisions.observations])

    def draw(self, rng: np.random.Generator, *shape: int) -> NDArray[np.float32]:
        """[*shape, F]."""
        drawn: NDArray[np.float32] = self.rows[rng.integers(len(self.rows), size=shape)]
        return drawn


def value_case(name: str, kind: Kind, batch_size: int, target_tau: float | None = 0.01) -> Case:
    """An update of a value method."""
    dqn = DqnConfig(learning_rate=3e-4, batch_size=batch_size, learn_every_steps=30, target_tau=target_tau)
    rows = (SEQUENCE, batch_size) if kind == "recurrent" else (batch_size,)

    def sides() -> tuple[Learn, Learn]:
        sizes = NetworkConfig(kind=kind, hidden=HIDDEN), N_FEATURES, N_ACTIONS, 1
        ours: ValueMethod
        if kind == "recurrent":
            ours, theirs = FusedDrqn(dqn, first_recurrent(*sizes)), PlainDqn(dqn, build_recurrent_network(*sizes))
        else:
            ours, theirs = FusedDqn(dqn, first_values(*sizes)), PlainDqn(dqn, build_network(*sizes))
        return lambda batch: ours.update(batch).metrics["loss"], theirs.update

    def batch(seen: Seen, rng: np.random.Generator) -> Batch:
        return Batch(
            observation_tm1=seen.draw(rng, *rows),
            action_tm1=rng.integers(N_ACTIONS, size=batch_size),
            reward_t=-rng.integers(1, 20, batch_size).astype(np.float32),
            discount_t=(0.9 * (rng.random(batch_size) < 0.9)).astype(np.float32),
            allowed_t=np.full(batch_size, ALL_ACTIONS),
            observation_t=seen.draw(rng, *rows),
            weights=1 - rng.random(batch_size, np.float32) / 2,
        )

    return Case(f"{name} update, {' sequences of '.join(map(str, reversed(rows)))} transitions", sides, batch)


def policy_case(name: str, batch_size: int, sil: SilConfig | None = None, epochs: int = 1) -> Case:
    """Updates of `ppo` on the same batch, or one of self-imitation if there is `sil`."""
    ppo = PpoConfig(learning_rate=5e-4, epochs=epochs)

    def sides() -> tuple[Learn, Learn]:
        config = NetworkConfig(kind="actor-critic", hidden=HIDDEN)
        sizes = config, N_FEATURES, N_ACTIONS, 1
        flat = FusedPolicy(first_actor_critic(*sizes), ppo.learning_rate, ppo.max_gradient_norm)
        plain = PlainPolicy(build_actor_critic(*sizes), ppo)
        if sil is not None:
            ours = Sil(sil, flat)
            return lambda batch: imitation_loss(ours.update(rows(batch), batch)[0], sil), lambda batch: plain.imitate(
                batch, sil
            )
        ours_of_ppo = Ppo(ppo, flat)
        return (
            lambda batch: ppo_loss(ours_of_ppo.update(rows(batch), batch, epochs)[-1], ppo),
            lambda batch: [plain.update(batch) for _ in range(epochs)][-1],
        )

    def batch(seen: Seen, rng: np.random.Generator) -> Experience:
        return Experience(
            observation_tm1=seen.draw(rng, batch_size),
            action_tm1=rng.integers(N_ACTIONS, size=batch_size),
            allowed_tm1=np.full(batch_size, ALL_ACTIONS),
            return_t=-rng.random(batch_size, np.float32),
            least_return_t=-rng.random(batch_size, np.float32),
            log_probability_tm1=-1 - rng.random(batch_size, np.float32),
            value_tm1=-rng.random(batch_size, np.float32),
        )

    what = "update" if epochs == 1 else f"episode of {epochs} updates"
    return Case(f"{name} {what}, {batch_size} transitions", sides, batch, epochs)


def rows(batch: Experience) -> SparseRows:
    """A batch's observations."""
    return sparse_rows(batch.observation_tm1)


def ppo_loss(metrics: Mapping[str, float], ppo: PpoConfig) -> float:
    """The loss that was descended on."""
    value_part, bonus = ppo.value_weight * metrics["value_loss"], ppo.entropy_weight * metrics["entropy"]
    return metrics["policy_loss"] + value_part - bonus


def imitation_loss(metrics: Mapping[str, float], sil: SilConfig) -> float:
    """The loss that was descended on."""
    return metrics["sil_policy_loss"] + sil.value_weight * metrics["sil_value_loss"]


CASES = (
    value_case("dqn", "plain", 128, target_tau=None),
    value_case("ddqn", "plain", 150),
    value_case("dddqn", "dueling", 150),
    value_case("drqn", "recurrent", 150),
    *(policy_case("ppo", batch_size) for batch_size in (60, 85, 120, 300, 1200)),
    policy_case("ppo", 85, epochs=10),
    policy_case("ppor", 300),
    policy_case("sil", 300, SilConfig(epochs=1, batch_size=300)),
)


def comparison(case: Case, seen: Seen, updates: int) -> Comparison:
    """The work of a case: so many updates from the same start, by each side."""

    def once(repeat: int) -> Sequence[Sample]:
        rng = np.random.default_rng(repeat)
        batches = [case.batch(seen, rng) for _ in range(updates)]
        learn_ours, learn_theirs = case.sides()
        our_s, ours = timed(lambda: [learn_ours(batch) for batch in batches])
        their_s, theirs = timed(lambda: [learn_theirs(batch) for batch in batches])
        if not np.allclose(ours, theirs, rtol=TOLERANCE):
            raise DisagreementError(f"{case.name}, repeat {repeat}: losses are {ours} and {theirs}")
        us = 1e6 / (updates * case.epochs)
        return [Sample(case.name, "us/update", our_s * us, their_s * us)]

    return Comparison(case.name, once)


def comparisons(updates: int) -> list[Comparison]:
    """All of them."""
    torch.set_num_threads(1)
    seen = Seen()
    return [*(comparison(case, seen, updates) for case in CASES), *episode_comparisons(seen.rows)]


if __name__ == "__main__":
    run("Compare updates with plain torch.", comparisons, updates=50)
