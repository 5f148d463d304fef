"""Where the processes of a run, and the runs of a study, go on the machines of a site."""

import re
from pathlib import Path

import pytest
import yaml

from railctl.analysis.study import Study
from railctl.common.strict import ConfigError
from railctl.deploy.placement import ACTOR_MIB, HOST_MIB, JOIN_MIB, RUN_MIB, Size, placed, placed_study

STUDY = Study.model_validate(
    {"name": "made", "contenders": ["dqn"], "levels": ["easy"], "seeds": [1, 2], "episodes": 300}
)


def place(given=None, name="one", nodes=3, actors=None, port=7447):
    return placed(given or {"lag": 3}, Path(), name, nodes, actors or {"easy": 2}, port)


def test_the_host_gets_what_the_run_needs_and_the_others_what_their_actors_need():
    placement = place({"lag": 3, "cluster": {"cores": 4, "actors": {"easy": 5}}}, actors={"easy": 2, "any": 1})
    assert (placement.joining, placement.actors) == (2, {"easy": 2, "any": 1})
    assert placement.host == Size(4, HOST_MIB + 5 * ACTOR_MIB)
    assert placement.joiner == Size(3, JOIN_MIB + 3 * ACTOR_MIB)


def test_commands_are_those_of_railctl():
    placement = place(actors={"easy": 2, "any": 1})
    assert " ".join(placement.up("run.yaml", "keys")) == (
        "railctl up --file run.yaml --name one --listen tls/0.0.0.0:7447 --keys keys"
    )
    assert " ".join(placement.join("node1", "keys", placement.actors)) == (
        "railctl join tls/node1:7447 --keys keys --actors easy=2,any=1 --wait 3600"
    )


def test_the_run_file_is_what_was_given_and_goes_for_it():
    given = {"algorithm": "ppo", "episodes": 30, "mix": {"easy": 0.5, "hard": 0.5}}
    placement = place(given, actors={"hard": 1})
    assert yaml.safe_load(placement.run_file) == given


def test_levels_of_which_a_node_has_no_actors_are_left_out():
    assert place(actors={"easy": 1, "any": 0}).actors == {"easy": 1}


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"given": {"lag": -1}}, "lag"),
        ({"given": {"algorithm": "dqqn"}}, "unknown algorithm 'dqqn'"),
        ({"name": "a b"}, "--name 'a b': use letters"),
        ({"nodes": 1}, "--nodes 1: the run's host is one of them, give 2 to 1025"),
        ({"nodes": 1026}, "--nodes 1026: the run's host is one of them, give 2 to 1025"),
        ({"actors": {"hard": 1}}, "--actors-per-node hard: the run has no such level"),
        ({"actors": {"easy": 0}}, "--actors-per-node: 0 in all, give 1 to 256"),
        ({"port": 80}, "--port 80: give one from 1024 to 65535"),
        ({"port": 65536}, "--port 65536: give one from 1024 to 65535"),
    ],
)
def test_what_is_wrong_is_named(changed, text):
    with pytest.raises(ConfigError, match=re.escape(text)):
        place(**changed)


def test_a_job_of_a_study_does_a_share_of_it():
    placement = placed_study(STUDY, "made", 2, 4)
    assert placement.size == Size(4, 4 * RUN_MIB)
    assert " ".join(placement.run("2")) == "railctl study run made --name made --share 2/2 --cores 4"


def test_the_file_of_a_study_is_found_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert placed_study(STUDY, "made.yaml", 1, 1).study == str(tmp_path / "made.yaml")


@pytest.mark.parametrize("shares", [0, 3])
def test_no_share_is_empty(shares):
    with pytest.raises(ConfigError, match=f"--shares {shares}: study made has 2 runs, make it 1 to 2 shares"):
        placed_study(STUDY, "made", shares, 1)
