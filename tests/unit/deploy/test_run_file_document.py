"""docs/run-file.md: it names every key there is, and its example is a run file."""

import re
from pathlib import Path

import pytest
import yaml

from railctl.common.strict import flat
from railctl.deploy.resolve import algorithms, resolve

DOCUMENT = (Path(__file__).parents[3] / "docs" / "run-file.md").read_text()
NAMED = set(re.findall(r"^\| `([\w.]+)` \|", DOCUMENT, re.MULTILINE))
WHOLE = ("mix", "cluster.actors")  # whose keys are names of levels
OF_THE_WORLD = ("levels", "observation", "decisions", "reward", "interlocking", "patience")


@pytest.mark.parametrize("algorithm", algorithms())
@pytest.mark.parametrize("replay", [{}, {"kind": "prioritized"}])
def test_every_key_of_a_resolved_run_is_named(algorithm, replay):
    has_choice = algorithm in ("dqn", "ddqn", "dddqn", "drqn")
    keys = flat(resolve({"algorithm": algorithm} | ({"replay": replay} if replay and has_choice else {})).plain())
    named = {next((whole for whole in WHOLE if key.startswith(f"{whole}.")), key) for key in keys}
    assert {key for key in named if key.partition(".")[0] not in OF_THE_WORLD} <= NAMED


def test_no_other_key_is_named():
    known = set()
    for algorithm in algorithms():
        known |= set(flat(resolve({"algorithm": algorithm}).plain()))
    known |= set(flat(resolve({"algorithm": "dqn", "replay": {"kind": "prioritized"}}).plain()))
    known |= set(flat(resolve({"algorithm": "ppo", "lag": "free"}).plain()))
    assert known | set(WHOLE) >= NAMED


def test_the_example_is_a_run_file():
    [example] = re.findall(r"```yaml\n(.*?)```", DOCUMENT, re.DOTALL)
    assert resolve(yaml.safe_load(example)).cluster.actors == {"easy": 1, "hard": 1}
