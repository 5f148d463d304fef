"""Imitation of a planner: the policy learns what the planner would do in the states that it came to itself.

Ross, Gordon & Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning",
AISTATS 2011, arXiv:1011.0686: data set aggregation. The planner is asked at every decision of every episode
(`common.rail.planning.judging`); at first it also acts, later the policy does, drawn as its probabilities say.

- The data set is a ring of the newest decisions, all alike; updates follow each episode, instead of training anew on
  all data after many of them.
- Decisions without a choice are left out.
- The loss is the cross entropy with the planner's action, over the actions that were allowed, and the squared error of
  the critic, which learns the returns of whoever acted. Gradients of actor and critic are clipped each.
- The learning rate falls evenly over the run, to a hundredth; episodes in which the teacher says nothing do not count.
"""

import numpy as np

from railctl.common.records.course import NONE, Course
from railctl.common.rules.imitate import ImitationConfig, Settings
from railctl.services.learner.algorithms.ppo import check_finite
from railctl.services.learner.experience import Counting, Experience, ExperienceReplay
from railctl.services.learner.learning import Learning, Trainer
from railctl.services.learner.policy_training import Policy, PolicyTrainer, build_network
from railctl.services.learner.sparse import sparse_rows

METRICS = ("cross_entropy", "value_loss", "agreement", "gradient_norm")
LEAST_RATE = 0.01  # of the learning rate


class Imitation(Counting):
    """Updates on batches from the replay after every episode."""

    def __init__(self, config: ImitationConfig, episodes: int, network: Policy, replay: ExperienceReplay) -> None:
        """`episodes` are those of the run."""
        super().__init__(replay, episodes)
        self._config = config
        self._network = network

    def learn(self, new: Experience) -> list[dict[str, float]]:
        """Learn from decisions, their actions being the teacher's.

        Returns:
            For each update `cross_entropy`, `value_loss`, `agreement`, of the policy's best actions with the teacher's,
            and `gradient_norm`, L2; all before the step.

        Raises:
            FloatingPointError: the loss is not finite; the network is as it was before this update.
        """
        self._replay.add(new)
        rate = self._config.learning_rate * max(LEAST_RATE, 1 - self._progress)
        self._count()
        if len(self._replay) < self._config.batch_size:
            return []
        return [self._update(rate) for _ in range(self._config.updates)]

    def _update(self, rate: float) -> dict[str, float]:
        batch, _ = self._replay.sample(self._config.batch_size)
        x = sparse_rows(batch.observation_tm1)
        *numbers, loss = self._network.clone(self._config.value_weight, rate, x, batch).tolist()
        check_finite(loss, "imitation.learning_rate")
        return dict(zip(METRICS, numbers, strict=True))


class Pupil(PolicyTrainer):
    """A trainer that learns the teacher's actions in the place of those that were taken."""

    def _lesson(self, course: Course) -> Course:
        decisions = course.decisions
        known = (decisions.labels != NONE) & (decisions.allowed >> decisions.labels.clip(0).astype(np.uint8) & 1 != 0)
        lessons = decisions.chosen(known)
        return course.model_copy(update={"decisions": lessons.model_copy(update={"actions": lessons.labels})})


def build(learning: Learning[Settings]) -> Trainer:
    """The trainer of a run of `imitate`."""
    config = learning.settings.imitation
    network = build_network(learning, config.learning_rate, config.max_gradient_norm)
    replay = ExperienceReplay(learning.settings.replay, learning.n_features, learning.seed)
    return Pupil(learning, network, Imitation(config, learning.episodes, network, replay))
