"""The plan of a cluster: which processes, and the commands that start them."""

import importlib.util
import os
import subprocess
from pathlib import Path

from railctl.common.interpreter import PYTHON, run_module
from railctl.common.levels.distributions import shipped
from railctl.deploy.plan import ENVIRONMENT, actors, cluster


def test_a_cluster_is_a_router_a_learner_an_evaluator_and_its_actors():
    specs = cluster({"easy": 2, "any": 1})
    assert [(spec.name, spec.role, spec.serves) for spec in specs] == [
        ("router", "router", None),
        ("learner", "learner", None),
        ("evaluator", "evaluator", None),
        ("actor-easy-0", "actor", "easy"),
        ("actor-easy-1", "actor", "easy"),
        ("actor-any-0", "actor", "any"),
    ]


def test_scaling_keeps_the_names_of_those_that_stay():
    assert actors({"easy": 3})[:2] == actors({"easy": 2})
    assert actors({"easy": 0}) == []


def test_names_are_unique():
    names = [spec.name for spec in cluster(dict.fromkeys((*shipped(), "any"), 3))]
    assert len(set(names)) == len(names) == 15


def test_commands_name_the_service_the_run_and_what_an_actor_is():
    router, *_, actor = cluster({"hard": 1})
    assert router.command(Path("runs/one")) == run_module("railctl.services.router", "--run", "runs/one")
    assert actor.command(Path("runs/one")) == [
        *run_module("railctl.services.actor", "--run", "runs/one"),
        *("--name", "actor-hard-0", "--serves", "hard"),
    ]


def test_every_service_can_be_started_as_a_module():
    for spec in cluster({"easy": 1}):
        assert importlib.util.find_spec(f"railctl.services.{spec.role}.__main__") is not None


def test_what_processes_log_has_no_colours():
    code = "from railctl.common.bus import open_router\nwith open_router('tcp/127.0.0.1:0'): pass"
    environment = os.environ | {"RUST_LOG": "debug"}
    logs = [
        subprocess.run([*PYTHON, "-c", code], env=environment | told, capture_output=True, check=True)
        for told in (ENVIRONMENT, {"NO_COLOR": ""})
    ]
    plain, coloured = (done.stdout + done.stderr for done in logs)
    assert b"zenoh" in plain
    assert b"\x1b[" not in plain
    assert b"\x1b[" in coloured
