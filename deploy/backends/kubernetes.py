"""Kubernetes: a Job for the host of a run, a Job of pods that join it for each level, and what these need.

Jobs, not Deployments: pods that are done shall stay done, and one that fails or is evicted is started again. All
processes of the host share a pod, for they talk through a socket that only their user reaches.
"""

import re
from typing import Any

import yaml

from railctl.common.strict import ConfigError, shortened
from railctl.common.task import WRONG_USAGE
from railctl.deploy.placement import Placement, Size, joiner_size
from railctl.deploy.whole_paths import files_of

# Kubernetes has stricter forms than we; the name of a Job, run-actors-level, may have 63 characters
NAME_FORM = re.compile(r"[a-z]([a-z0-9-]{0,37}[a-z0-9])?")
LEVEL_FORM = re.compile(r"[a-z0-9]([a-z0-9-]{0,14}[a-z0-9])?")
IMAGE_FORM = re.compile(r"[A-Za-z0-9][A-Za-z0-9._:/@-]*")
USER = 10001  # of the image
KEYS, RUN_FILE, RUNS = "/etc/railctl/keys", "/etc/railctl/run/run.yaml", "/runs"
COMPILED, COPY = "/var/cache/railctl", "/compiled"  # the image's compiled code, and what a pod may write of it
STORAGE = "10Gi"
HOST_ENDS_S, JOINER_ENDS_S = 120, 60
MOST_FAILURES = 100  # of pods, evictions left out: supervisors inside have mended what can be mended

Manifest = dict[str, Any]


def manifests(placement: Placement, image: str) -> str:
    """All that `kubectl apply` needs, with what has to be there before.

    Raises:
        ConfigError: a name is none that Kubernetes takes, or the run reads files of this machine.
    """
    _check(placement, image)
    name = placement.name
    documents = [
        _run_file(placement),
        _storage(name),
        _service(placement),
        _host(placement, image),
        *(_joiners(placement, image, level) for level in placement.actors),
    ]
    return _keys_first(name) + yaml.dump_all(documents, Dumper=_Written, sort_keys=False)


class _Written(yaml.SafeDumper):
    """YAML as people write it: everything where it belongs, texts line by line."""

    def ignore_aliases(self, _data: object) -> bool:
        return True

    def represent_text(self, text: str) -> yaml.Node:
        return self.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Written.add_representer(str, _Written.represent_text)


def _check(placement: Placement, image: str) -> None:
    if IMAGE_FORM.fullmatch(image) is None:
        form = "letters, digits, '.', '_', ':', '/', '@' and '-'"
        raise ConfigError(f"--image {shortened(image)}: names of images have {form}: write REGISTRY/NAME:TAG")
    if NAME_FORM.fullmatch(placement.name) is None:
        form = "a small letter, then small letters, digits and '-', at most 39"
        raise ConfigError(f"--name {shortened(placement.name)}: Kubernetes wants {form}")
    for level in placement.actors:
        if LEVEL_FORM.fullmatch(level) is None:
            form = "small letters, digits and '-', at most 16"
            raise ConfigError(f"--actors-per-node {shortened(level)}: a Job is named after it, of {form}: rename it")
    if keys := files_of(placement.given):
        raise ConfigError(f"{keys[0]}: pods do not see files of this machine: use levels that are generated, or Slurm")


def _keys_first(name: str) -> str:
    """How the secrets are made that the manifests only name."""
    secrets = {
        _secret(name, role): " ".join(f"--from-file=keys/{file}" for file in ("ca.pem", f"{role}.pem", f"{role}.key"))
        for role in ("host", "actor")
    }
    commands = [f"railctl keys create keys --host {name}"]
    commands += [f"kubectl create secret generic {secret} {files}" for secret, files in secrets.items()]
    return "".join(f"# {line}\n" for line in ("Once, before these are applied:", *commands))


def _secret(name: str, role: str) -> str:
    return f"{name}-{role}-keys"


def _labels(name: str, part: str) -> dict[str, str]:
    return {
        "app.kubernetes.io/name": "railctl",
        "app.kubernetes.io/instance": name,
        "app.kubernetes.io/component": part,
    }


def _object(api: str, kind: str, name: str, labels: dict[str, str], **rest: Any) -> Manifest:
    return {"apiVersion": api, "kind": kind, "metadata": {"name": name, "labels": labels}, **rest}


def _run_file(placement: Placement) -> Manifest:
    name = placement.name
    return _object("v1", "ConfigMap", f"{name}-run", _labels(name, "host"), data={"run.yaml": placement.run_file})


def _storage(name: str) -> Manifest:
    spec = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": STORAGE}}}
    return _object("v1", "PersistentVolumeClaim", f"{name}-runs", _labels(name, "host"), spec=spec)


def _service(placement: Placement) -> Manifest:
    labels = _labels(placement.name, "host")
    ports = [{"name": "join", "port": placement.port, "targetPort": "join"}]
    return _object("v1", "Service", placement.name, labels, spec={"selector": labels, "ports": ports})


def _host(placement: Placement, image: str) -> Manifest:
    name = placement.name
    volumes = {
        "runs": (RUNS, {"persistentVolumeClaim": {"claimName": f"{name}-runs"}}),
        "run-file": (RUN_FILE.rpartition("/")[0], {"configMap": {"name": f"{name}-run"}}),
        "keys": (KEYS, _keys_volume(name, "host")),
    }
    words = placement.up(RUN_FILE, KEYS)
    pod = _pod(image, words, placement.host, volumes, HOST_ENDS_S)
    pod["containers"][0]["ports"] = [{"name": "join", "containerPort": placement.port}]
    return _job(f"{name}-host", _labels(name, "host"), pod, 1)


def _joiners(placement: Placement, image: str, level: str) -> Manifest:
    name, counts = placement.name, {level: placement.actors[level]}
    volumes = {"keys": (KEYS, _keys_volume(name, "actor"))}
    pod = _pod(image, placement.join(name, KEYS, counts), joiner_size(counts), volumes, JOINER_ENDS_S)
    return _job(f"{name}-actors-{level}", _labels(name, f"actors-{level}"), pod, placement.joining)


def _keys_volume(name: str, role: str) -> Manifest:
    return {"secret": {"secretName": _secret(name, role), "defaultMode": 0o440}}


def _job(name: str, labels: dict[str, str], pod: Manifest, pods: int) -> Manifest:
    """Pods that are started again until one of them is done, never two for one; wrong usage would only come again."""
    policy = [
        {"action": "FailJob", "onExitCodes": {"operator": "In", "values": [WRONG_USAGE]}},
        {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]},
    ]
    spec = {
        "parallelism": pods,
        "backoffLimit": MOST_FAILURES,
        "podReplacementPolicy": "Failed",
        "podFailurePolicy": {"rules": policy},
        "template": {"metadata": {"labels": labels}, "spec": pod},
    }
    return _object("batch/v1", "Job", name, labels, spec=spec)


def _pod(image: str, words: list[str], size: Size, volumes: dict[str, tuple[str, Manifest]], ends_s: int) -> Manifest:
    """A pod that runs a command of the image; `volumes` are by name, with where they are mounted."""
    volumes = {"tmp": ("/tmp", {"emptyDir": {}}), "compiled": (COMPILED, {"emptyDir": {}}), **volumes}  # noqa: S108
    resources = {"cpu": str(size.cores), "memory": f"{size.memory_mib}Mi"}
    common = {
        "image": image,
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        },
        "resources": {"requests": resources, "limits": resources},
    }
    mounts = [
        {"name": name, "mountPath": path, "readOnly": name in ("keys", "run-file")}
        for name, (path, _) in volumes.items()
    ]
    writes = [{"name": "compiled", "mountPath": COPY}]
    copy = {"name": "compiled", "command": ["cp", "-r", f"{COMPILED}/.", COPY], "volumeMounts": writes, **common}
    return {
        "restartPolicy": "Never",
        "terminationGracePeriodSeconds": ends_s,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER,
            "runAsGroup": USER,
            "fsGroup": USER,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "initContainers": [copy],
        "containers": [{"name": "railctl", "args": words[1:], "volumeMounts": mounts, **common}],
        "volumes": [{"name": name, **source} for name, (_, source) in volumes.items()],
    }
