"""The algorithm of CONTRIBUTING's example works once its text is followed: three files, and no other is touched."""

import os
import re
import shutil
import subprocess
from pathlib import Path

from railctl.common.interpreter import PYTHON

HERE = Path(__file__).parent
ROOT = HERE.parents[3]
[TEXT] = re.findall(
    r"^## Adding an algorithm\n(.*?)^## ", (ROOT / "CONTRIBUTING.md").read_text(), re.DOTALL | re.MULTILINE
)
LEARNED = """
import pytest
import torch
from made_episodes import make_episode
from railctl.common.rules.munchausen import MunchausenConfig
from railctl.common.strict import ConfigError
from railctl.deploy.resolve import resolve
from railctl.services.learner.algorithms.munchausen import munchausen_target
from railctl.services.learner.learning import build_trainer, learning_of

config = MunchausenConfig(temperature=1.0, share=0.4, least=-10.0)
values = torch.tensor([[0.0, 0.0]])
# by hand: the action taken has the probability 1/2, and the soft value of two zeros is ln 2
target = munchausen_target(torch.tensor([-1.0]), torch.tensor([0.5]), values, torch.tensor([1]), values, config)
assert target.tolist() == pytest.approx([-1 + (0.5 - 0.4) * 0.693147])

config = resolve({"algorithm": "munchausen", "munchausen": {"share": 0.8}, "dqn": {"batch_size": 4}})
assert config.learning.munchausen.share == 0.8
for wrong, told in (
    ({"munchausen": {"shar": 1}}, "unknown key munchausen.shar: did you mean share?"),
    ({"ppo": {"batch_size": 3}}, "ppo"),
    ({"dqn": {"target_tau": None}}, "dqn.target_tau"),
):
    with pytest.raises(ConfigError, match=told):
        resolve({"algorithm": "munchausen"} | wrong)
trainer = build_trainer("munchausen", learning_of(config))
before = trainer.weights()
metrics = trainer.train(make_episode(0, n_features=config.world.n_features))
assert metrics["updates"] > 0 and metrics["loss"] > 0
assert any((before[name] != array).any() for name, array in trainer.weights().items())
"""


def test_the_example_works(tmp_path):
    for package in ("common", "deploy", "services"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    settings, rule = re.findall(r"^```python\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    [section] = re.findall(r"^```yaml\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    preset = (tmp_path / "deploy/presets/ddqn.yaml").read_text().replace("rule: dqn\n", "rule: munchausen\n")
    for name, text in (
        ("common/rules/munchausen.py", settings),
        ("services/learner/algorithms/munchausen.py", rule),
        ("deploy/presets/munchausen.yaml", f"{preset}\n{section}"),
    ):
        assert f"`{name}`" in TEXT
        (tmp_path / name).write_text(text)
    process = subprocess.run(
        [*PYTHON, "-c", LEARNED],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{HERE}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
