"""Every rule gives the same bits in fresh processes, at any alignment, and compiled for another kind of processor.

Run as a program it trains each rule briefly on arrays at a given misalignment and prints hashes of the weights.
"""

import os
import subprocess
import sys

import pytest
import test_policy_training
import test_training
from made_episodes import make_episode

from railctl.common.interpreter import PYTHON

OLD_PROCESSOR = {  # has neither AVX nor a fused multiply-add
    "NUMBA_CPU_NAME": "nehalem",
    "NUMBA_CPU_FEATURES": "+sse4.2,+popcnt",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3",
}
LEAST_UPDATES = 9


def printed(offset, **changes):
    paths = os.pathsep.join(filter(None, sys.path))
    environment = os.environ | {"PYTHONPATH": paths} | changes
    command = [*PYTHON, __file__, str(offset)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(line.split(": ") for line in done.stdout.splitlines())


def test_alignment_makes_no_difference_to_any_rule():
    here = printed(4)
    assert set(here) == {*test_training.VARIANTS, *test_policy_training.RULES}
    assert len(set(here.values())) == len(here)
    assert printed(13) == here


@pytest.mark.slow  # compiles everything anew
def test_another_kind_of_processor_makes_no_difference_to_any_rule():
    assert printed(0, **OLD_PROCESSOR) == printed(0)


def trainers():
    """Each rule by name, and its episodes by number and offset; of the size of the real ones."""
    size = {"n_features": 252, "hidden": (128, 128), "batch_size": 150}
    for name, variant in test_training.VARIANTS.items():
        trainer = test_training.make_trainer(**size, learn_every_steps=10, capacity=5000, **variant)
        yield name, trainer, lambda number, offset: make_episode(number, 252, offset=offset, density=0.1)
    for rule in test_policy_training.RULES:
        trainer = test_policy_training.make_trainer(rule, **size, capacity=400)
        yield rule, trainer, lambda number, offset: test_policy_training.make_policy_episode(number, 252, offset)


def main(offset):
    for name, trainer, episode in trainers():
        updates = sum(trainer.train(episode(number, offset))["updates"] for number in range(7))
        if updates < LEAST_UPDATES:
            raise RuntimeError(f"{name} made only {updates} updates")
        sys.stdout.write(f"{name}: {test_training.weights_hash(trainer)}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]))
