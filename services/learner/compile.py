"""python -m railctl.services.learner.compile: compiles what learners of every rule run, so that no run's first episode has to.

The machine code is kept beside the sources, or in the user's cache where those cannot be written.
"""

from itertools import product

import numpy as np

from railctl.common.board import look_over
from railctl.common.policy.flat import Order
from railctl.common.rules import settings_of
from railctl.common.rules.settings import RuleSettings
from railctl.common.task import carry_out
from railctl.services.learner.learning import Learning, build_trainer
from railctl.services.learner.selfcheck import N_FEATURES, made_up_episode

SECTIONS = {
    "dqn": {
        "learning_rate": 1e-3,
        "batch_size": 8,
        "learn_every_steps": 30,
        "target_tau": 0.5,
        "target_every": "episode",
    },
    "ppo": {"learning_rate": 1e-3, "epochs": 1},
    "sil": {"epochs": 1, "batch_size": 8},
    "imitation": {"learning_rate": 1e-3, "updates": 1, "batch_size": 8},
    "uniform": {"kind": "uniform", "capacity": 1000},
    "prioritized": {"kind": "prioritized", "capacity": 1000, "beta": 0},
}
KINDS = {"dqn": ("dueling", "dueling-apart")}  # of networks, where updates differ by them
RULES = {
    "dqn": {"dqn": "dqn", "replay": "uniform"},
    "drqn": {"dqn": "dqn", "replay": "prioritized"},
    "imitate": {"imitation": "imitation", "replay": "uniform"},
    "sil": {"ppo": "ppo", "sil": "sil", "replay": "prioritized"},
}
HIDDEN = {"hidden": [16, 16]}
WIDTHS = N_FEATURES, 300  # the replay numbers features by bytes, or beyond 256 by two


def learning(rule: str, n_features: int = N_FEATURES, kind: str | None = None) -> Learning[RuleSettings]:
    """A small setting; the network is of the rule's own kind if none is given."""
    sections = {key: SECTIONS[name] for key, name in RULES[rule].items()}
    network = HIDDEN | ({} if kind is None else {"kind": kind})
    settings = settings_of(rule).model_validate({"network": network, **sections})
    return Learning(1, 2, settings, n_features, off_policy=True)  # what corrects is compiled, too


def main() -> None:
    """Two episodes with each kind of network and replay."""
    cases = [(rule, kind) for rule in RULES for kind in KINDS.get(rule, (None,))]
    for (rule, kind), n_features in product(cases, WIDTHS):
        trainer = build_trainer(rule, learning(rule, n_features, kind))
        for number in range(2):
            trainer.train(made_up_episode(number, n_features))
        trainer.restore(trainer.state())
        look_over(Order.of(weights := trainer.weights()).pack(weights).view(np.int64))


if __name__ == "__main__":
    carry_out(main)
