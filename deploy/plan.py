"""The plan of a cluster: which processes, started how. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from railctl.common.interpreter import run_module
from railctl.common.records.base import Role

# One thread a process for numerics, bits that do not depend on memory alignment, and logs without colours.
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "MKL_CBWR": "AUTO,STRICT",
    "PYTHONUNBUFFERED": "1",
    "NO_COLOR": "1",
}


@dataclass(frozen=True)
class ProcessSpec:
    """A process of the cluster and the command that starts it."""

    name: str
    role: Role
    serves: str | None = None  # actors: the levels of which name, or any

    def command(self, run: Path) -> list[str]:
        command = run_module(f"railctl.services.{self.role}", "--run", str(run))
        if self.serves is not None:
            command += ["--name", self.name, "--serves", self.serves]
        return command


def actors(counts: Mapping[str, int], host: str = "") -> list[ProcessSpec]:
    """The actors for these counts; scaling keeps the names of those that stay, elsewhere they bear that of who joined.

    >>> [spec.name for spec in actors({"easy": 2})]
    ['actor-easy-0', 'actor-easy-1']
    >>> [spec.name for spec in actors({"easy": 1}, "node7-4711")]
    ['actor-node7-4711-easy-0']
    """
    stem = f"actor-{host}" if host else "actor"
    return [
        ProcessSpec(f"{stem}-{serves}-{index}", "actor", serves)
        for serves, count in counts.items()
        for index in range(count)
    ]


def cluster(counts: Mapping[str, int]) -> list[ProcessSpec]:
    """Every process of a run, but its supervisor."""
    return [
        ProcessSpec("router", "router"),
        ProcessSpec("learner", "learner"),
        ProcessSpec("evaluator", "evaluator"),
        *actors(counts),
    ]
