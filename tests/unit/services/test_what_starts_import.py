"""What processes of a run import until they work: what one has no use for would keep the first episode waiting."""

import subprocess

import pytest

from railctl.common.interpreter import PYTHON

RESOLVED = {
    name: f"from railctl.deploy.resolve import resolve; config = resolve({{'algorithm': {name!r}}})\n"
    for name in ("dddqn", "sil")
}
ACTING = """
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.leased import LeasePlayer
from railctl.common.policy.player import chooser_of
import railctl.services.actor.service, services.evaluator.service
LeasePlayer(config, LevelSupply(config.world.levels), chooser_of(config)).get_ready("easy")
"""
LEARNING = """
import railctl.services.learner.service
from railctl.services.learner.learning import build_trainer, learning_of
from railctl.services.learner.selfcheck import made_up_episode
trainer = build_trainer(config.rule, learning_of(config))
for number in range(2):
    trainer.train(made_up_episode(number))
trainer.restore(trainer.state())
"""
ELSEWHERE = ("flatland", "boto3", "botocore", "pandas", "matplotlib", "networkx", "PIL")


def imported(code, names):
    """Which of these modules a fresh process has when it has run this."""
    ask = f"import sys\n{code}\nprint(*(name for name in {names} if name in sys.modules))"
    done = subprocess.run([*PYTHON, "-c", ask], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("import railctl.services.router.__main__", (*ELSEWHERE, "torch", "numba", "scipy")),
        ("import railctl.services.actor.service, services.evaluator.service", (*ELSEWHERE, "torch", "numba", "scipy")),
        *((RESOLVED[name] + ACTING, (*ELSEWHERE, "torch")) for name in RESOLVED),
        *((RESOLVED[name] + LEARNING, (*ELSEWHERE, "torch")) for name in RESOLVED),
    ],
    ids=["router", "imports", "acting-dddqn", "acting-sil", "learning-dddqn", "learning-sil"],
)
def test_nobody_imports_what_it_has_no_use_for(code, names):
    assert imported(code, names) == []


def test_what_is_imported_is_noticed():
    assert imported("import sympy.core", ("sympy", "torch")) == ["sympy"]
