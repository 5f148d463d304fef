"""Self-imitation learning: after `ppo`'s epochs on the episode, the policy learns again what turned out well before.

Oh, Guo, Singh & Lee, "Self-Imitation Learning", 2018, arXiv:1806.05635; section 4.3 and Algorithm 4 of the study.

A decision is taught if its return exceeds the critic's value, in proportion to the difference. That difference is also
its priority in the replay: first with the value when it was made, then with that of the last batch it was in.

What the text leaves open:
- Returns here take a train that the step limit stopped as one that never arrives (`sil.returns: bootstrapped` takes
  those of `ppo`'s updates instead, as the text's one R for both may mean). Imitation rests on returns being less
  than the best policy's values (section 3.2 of Oh et al., who have no step limit); the critic's guess of what follows
  is not, and an early, hopeful one would stay in the replay and be imitated, with all that led to being stuck.
- Means are over the whole batch; decisions that did not turn out well count as zeros.
- No weights of importance. That prioritised batches are not uniform is what they are for here (the text: "ensure that
  each sampled batch contains more than average positive experiences"), and weights divided by the largest of a batch
  would let a single decision of priority zero silence all others. So the replay's `beta` has to be 0.
- A replay may begin with demonstrations, those of a mentor. They are decisions like all others: imitated for as long as
  they turn out better than the critic thinks, and overwritten in the end.
- Neither loss is clipped, there is no entropy bonus besides that of `ppo`'s epochs, and both kinds of epochs share one
  Adam. Gradients are clipped as there.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.rules.sil import Settings, SilConfig
from railctl.services.learner.algorithms.ppo import WholeEpisodes, check_finite
from railctl.services.learner.experience import Counting, Experience, ExperienceReplay
from railctl.services.learner.learning import Learning, Trainer
from railctl.services.learner.policy_training import Policy, PolicyTrainer, build_network
from railctl.services.learner.sparse import SparseRows, sparse_rows

METRICS = ("sil_policy_loss", "sil_value_loss", "sil_gain", "sil_positive_share", "sil_gradient_norm")


class Sil:
    """Trains an actor-critic, a batch at a time."""

    def __init__(self, config: SilConfig, network: Policy) -> None:
        self._config = config
        self._network = network

    def update(self, x: SparseRows, batch: Experience) -> tuple[dict[str, float], NDArray[np.float32]]:
        """One step of Adam on `policy loss + beta * value loss`, means over the batch.

        Args:
            x: [B, F], the batch's observations.
            batch: B decisions.

        Returns:
            `sil_policy_loss` and `sil_value_loss`; `sil_gain`, the mean of (R - V)+, and `sil_positive_share`, of
            decisions that have any; `sil_gradient_norm`, L2; all before the step. And the gains [B].

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was.
        """
        numbers, gains = self._network.imitate(self._config.value_weight, x, batch)
        check_finite(float(numbers[-1]))
        return dict(zip(METRICS, numbers[:-1].tolist(), strict=True)), gains


class SelfImitation(Counting):
    """`ppo`'s epochs on the whole episode, then epochs on prioritised batches of all episodes."""

    def __init__(
        self, config: SilConfig, episodes: int, on_policy: WholeEpisodes, sil: Sil, replay: ExperienceReplay
    ) -> None:
        """`episodes` are those of the run."""
        super().__init__(replay, episodes)
        self._config = config
        self._on_policy = on_policy
        self._sil = sil

    def learn(self, new: Experience) -> list[dict[str, float]]:
        rows = self._on_policy.learn(new)
        kept = self._with_returns(new)
        self._replay.add(kept, _priorities(kept.least_return_t - kept.value_tm1))
        if len(self._replay) >= self._config.batch_size:
            rows += [self._imitate() for _ in range(self._config.epochs)]
        self._count()
        return rows

    def remember(self, shown: Experience, least: float) -> None:
        """Take in a demonstration, whose decisions are better at first than the `least` value of all, by far."""
        kept = self._with_returns(shown)
        self._replay.add(kept, _priorities(kept.least_return_t - np.float32(least)))

    def _with_returns(self, new: Experience) -> Experience:
        """Decisions whose returns for imitation are those of the settings."""
        return new if self._config.returns == "least" else new._replace(least_return_t=new.return_t)

    def _imitate(self) -> dict[str, float]:
        batch, places = self._replay.sample(self._config.batch_size)
        metrics, gain = self._sil.update(sparse_rows(batch.observation_tm1), batch)
        self._replay.reprioritise(places, _priorities(gain))
        return metrics


def _priorities(gain: NDArray[np.float32]) -> NDArray[np.float64]:
    """The positive parts."""
    return np.maximum(gain, 0).astype(np.float64)


def build(learning: Learning[Settings]) -> Trainer:
    """The trainer of a run of `sil`."""
    settings = learning.settings
    network = build_network(learning, settings.ppo.learning_rate, settings.ppo.max_gradient_norm)
    replay = ExperienceReplay(settings.replay, learning.n_features, learning.seed)
    on_policy = WholeEpisodes(settings.ppo, network)
    rule = SelfImitation(settings.sil, learning.episodes, on_policy, Sil(settings.sil, network), replay)
    trainer = PolicyTrainer(learning, network, rule)
    for course in learning.demonstrations:
        rule.remember(trainer.experience(course), learning.least_reward)
    return trainer
