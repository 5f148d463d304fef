"""PPO with a replay buffer: each epoch is an update on a batch of decisions of many episodes, drawn uniformly.

Section 4.3 of the study. A decision is kept with its return, and with the log-probability and the value that it had
when it was made; `ppo`'s losses are taken with these. So the ratio of probabilities reaches far beyond one episode, and
for decisions that the policy has long moved away from the clipped objective has no gradient: they no longer teach the
actor what it already does, only what it has unlearned.

What the text leaves open: there is no update until the replay holds a batch.
"""

from railctl.common.rules.ppor import ReplayedPpoConfig, Settings
from railctl.services.learner.algorithms.ppo import Ppo
from railctl.services.learner.experience import Experience, ExperienceReplay, WithReplay
from railctl.services.learner.learning import Learning, Trainer
from railctl.services.learner.policy_training import Policy, PolicyTrainer, build_network
from railctl.services.learner.sparse import sparse_rows


class FromReplay(WithReplay):
    """Every epoch is an update on a batch from the replay."""

    def __init__(self, config: ReplayedPpoConfig, network: Policy, replay: ExperienceReplay) -> None:
        super().__init__(replay)
        self._epochs = config.epochs
        self._batch_size = config.batch_size
        self._ppo = Ppo(config, network)

    def learn(self, new: Experience) -> list[dict[str, float]]:
        self._replay.add(new)
        if len(self._replay) < self._batch_size:
            return []
        return [row for _ in range(self._epochs) for row in self._update()]

    def _update(self) -> list[dict[str, float]]:
        batch, _ = self._replay.sample(self._batch_size)
        return self._ppo.update(sparse_rows(batch.observation_tm1), batch)


def build(learning: Learning[Settings]) -> Trainer:
    """The trainer of a run of `ppor`."""
    settings = learning.settings
    network = build_network(learning, settings.ppo.learning_rate, settings.ppo.max_gradient_norm)
    replay = ExperienceReplay(settings.replay, learning.n_features, learning.seed)
    return PolicyTrainer(learning, network, FromReplay(settings.ppo, network, replay))
