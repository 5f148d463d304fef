"""Manifests for Kubernetes, against its official schemas, in which no unknown field passes."""

from pathlib import Path

import kubernetes_validate
import pytest
import yaml

from railctl.common.strict import ConfigError
from railctl.deploy.backends.kubernetes import manifests
from railctl.deploy.placement import placed

VERSIONS = ("1.31", "1.37")  # the first in which all that is used is stable but `podReplacementPolicy`, and the newest


def rendered(given=None, name="demo", actors=None, image="registry.example.org/railctl:1"):
    placement = placed(given or {"lag": 7}, Path(), name, 3, actors or {"easy": 4}, 7447)
    return manifests(placement, image)


def documents(text):
    return {(found["kind"], found["metadata"]["name"]): found for found in yaml.safe_load_all(text)}


@pytest.fixture(scope="module")
def mixed():
    given = {"lag": 7, "mix": {"easy": 0.5, "hard": 0.5}, "cluster": {"cores": 3, "actors": {"any": 2}}}
    return documents(rendered(given, actors={"easy": 4, "hard": 2}))


@pytest.mark.parametrize("version", VERSIONS)
def test_all_of_them_are_what_kubernetes_takes(mixed, version):
    for document in mixed.values():
        kubernetes_validate.validate(document, version, strict=True)


def test_what_kubernetes_does_not_know_is_noticed(mixed):
    job = mixed["Job", "demo-host"]
    wrong = job | {"spec": job["spec"] | {"parallellism": 1}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, VERSIONS[-1], strict=True)


def test_there_is_a_host_and_a_job_a_level(mixed):
    assert set(mixed) == {
        ("ConfigMap", "demo-run"),
        ("PersistentVolumeClaim", "demo-runs"),
        ("Service", "demo"),
        ("Job", "demo-host"),
        ("Job", "demo-actors-easy"),
        ("Job", "demo-actors-hard"),
    }
    assert [mixed["Job", name]["spec"]["parallelism"] for name in ("demo-host", "demo-actors-hard")] == [1, 2]
    [container] = mixed["Job", "demo-actors-hard"]["spec"]["template"]["spec"]["containers"]
    assert container["args"] == [
        *("join", "tls/demo:7447", "--keys", "/etc/railctl/keys", "--actors", "hard=2", "--wait", "3600")
    ]
    assert container["resources"]["limits"] == {"cpu": "2", "memory": "2048Mi"}
    [container] = mixed["Job", "demo-host"]["spec"]["template"]["spec"]["containers"]
    assert container["resources"]["requests"] == {"cpu": "3", "memory": "5120Mi"}


def test_the_service_finds_the_host(mixed):
    service, pod = mixed["Service", "demo"]["spec"], mixed["Job", "demo-host"]["spec"]["template"]
    assert service["selector"] == pod["metadata"]["labels"]
    assert service["selector"] != mixed["Job", "demo-actors-easy"]["spec"]["template"]["metadata"]["labels"]
    [container] = pod["spec"]["containers"]
    assert {"name": service["ports"][0]["targetPort"], "containerPort": 7447} in container["ports"]


def test_what_is_mounted_is_there(mixed):
    for (kind, _), job in mixed.items():
        if kind == "Job":
            pod = job["spec"]["template"]["spec"]
            mounted = {
                mount["name"]
                for container in (*pod["initContainers"], *pod["containers"])
                for mount in container["volumeMounts"]
            }
            assert mounted == {volume["name"] for volume in pod["volumes"]}
            for container in (*pod["initContainers"], *pod["containers"]):
                paths = [mount["mountPath"] for mount in container["volumeMounts"]]
                assert len(set(paths)) == len(paths)


def test_nobody_but_the_host_has_its_keys(mixed):
    secrets = {
        name: [
            volume["secret"]["secretName"]
            for volume in job["spec"]["template"]["spec"]["volumes"]
            if "secret" in volume
        ]
        for (kind, name), job in mixed.items()
        if kind == "Job"
    }
    actors = ["demo-actor-keys"]
    assert secrets == {"demo-host": ["demo-host-keys"], "demo-actors-easy": actors, "demo-actors-hard": actors}


def test_the_keys_are_made_before_and_are_not_in_it():
    begin, _, rest = rendered().partition("apiVersion")
    assert "# railctl keys create keys --host demo\n" in begin
    assert "demo-actor-keys --from-file=keys/ca.pem --from-file=keys/actor.pem --from-file=keys/actor.key" in begin
    assert "kind: Secret" not in rest


def test_no_pod_may_more_than_it_must(mixed):
    for (kind, _), job in mixed.items():
        if kind == "Job":
            pod = job["spec"]["template"]["spec"]
            assert pod["securityContext"]["runAsNonRoot"]
            assert not pod["automountServiceAccountToken"]
            for container in (*pod["initContainers"], *pod["containers"]):
                may = container["securityContext"]
                assert (may["allowPrivilegeEscalation"], may["readOnlyRootFilesystem"]) == (False, True)
                assert may["capabilities"] == {"drop": ["ALL"]}


def test_the_host_starts_from_the_run_file_that_was_checked(mixed):
    assert yaml.safe_load(mixed["ConfigMap", "demo-run"]["data"]["run.yaml"])["mix"] == {"easy": 0.5, "hard": 0.5}
    pod = mixed["Job", "demo-host"]["spec"]["template"]["spec"]
    [container] = pod["containers"]
    folder, file = container["args"][2].rsplit("/", 1)
    assert file in mixed["ConfigMap", "demo-run"]["data"]
    [mount] = [mount for mount in container["volumeMounts"] if mount["mountPath"] == folder]
    [volume] = [volume for volume in pod["volumes"] if volume["name"] == mount["name"]]
    assert volume["configMap"]["name"] == "demo-run"


def test_pods_are_started_again_unless_their_usage_is_wrong(mixed):
    for (kind, _), job in mixed.items():
        if kind == "Job":
            rules = job["spec"]["podFailurePolicy"]["rules"]
            assert [(rule["action"], rule.get("onExitCodes", {}).get("values")) for rule in rules] == [
                ("FailJob", [2]),
                ("Ignore", None),
            ]
            assert job["spec"]["podReplacementPolicy"] == "Failed"
            assert job["spec"]["template"]["spec"]["restartPolicy"] == "Never"  # as failure policies demand


@pytest.mark.parametrize("name", ["Demo", "de.mo", "1demo", "demo-", "d" * 40])
def test_names_that_kubernetes_does_not_take_are_refused(name):
    with pytest.raises(ConfigError, match=r"^--name .*: Kubernetes wants a small letter, then"):
        rendered(name=name)


def test_levels_after_which_no_job_can_be_named_are_refused():
    levels = {"Rush_1": {"rules": "stock", "size": [30, 30], "trains": 3, "cities": 3}}
    with pytest.raises(ConfigError, match=r"^--actors-per-node '?Rush_1'?: a Job is named after it"):
        rendered({"levels": levels, "mix": {"Rush_1": 1}, "lag": 1}, actors={"Rush_1": 1})


def test_the_longest_names_that_pass_name_jobs_that_kubernetes_takes():
    level = "l" * 16
    levels = {level: {"rules": "stock", "size": [30, 30], "trains": 3, "cities": 3}}
    text = rendered({"levels": levels, "mix": {level: 1}, "lag": 1}, name="d" * 39, actors={level: 1})
    assert max(len(name) for kind, name in documents(text) if kind == "Job") == 63  # it labels pods with it


@pytest.mark.parametrize("image", ["a b", "a\nb: c", "--- #", "-x", "$(rm)"])
def test_what_no_image_is_called_is_refused(image):
    with pytest.raises(ConfigError, match=r"^--image .*: names of images have .*: write REGISTRY/NAME:TAG$"):
        rendered(image=image)
