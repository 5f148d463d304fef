"""python -m services.learner.compile: compiles what learners of every rule run, so that no run's first episode has to.

The machine code is kept beside the sources, or in the user's cache where those cannot be written.
"""

from typing import Any

from common.config import DqnConfig, NetworkConfig, PpoConfig, ReplayConfig, SilConfig
from services.learner.learning import Learning, build_trainer
from services.learner.selfcheck import made_up_episode

DQN = DqnConfig(learning_rate=1e-3, batch_size=8, learn_every_steps=30, target_tau=0.5)
PPO = PpoConfig(learning_rate=1e-3, epochs=1)


def learning(kind: str, replay: ReplayConfig, **sections: Any) -> Learning:
    """A small setting."""
    network = NetworkConfig.model_validate({"kind": kind, "hidden": [16, 16]})
    return Learning(seed=1, episodes=2, discount=0.9, network=network, replay=replay, **sections)


def main() -> None:
    """Two episodes with each kind of network and replay."""
    uniform = ReplayConfig(capacity=1000)
    prioritised = ReplayConfig(kind="prioritized", capacity=1000, beta=0)
    settings = {
        "dqn": learning("dueling", uniform, dqn=DQN),
        "drqn": learning("recurrent", prioritised, dqn=DQN),
        "sil": learning("actor-critic", prioritised, ppo=PPO, sil=SilConfig(epochs=1, batch_size=8)),
    }
    for rule, setting in settings.items():
        trainer = build_trainer(rule, setting)
        for number in range(2):
            trainer.train(made_up_episode(number))
        trainer.restore(trainer.state())


if __name__ == "__main__":
    main()
