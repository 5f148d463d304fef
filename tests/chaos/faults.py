"""What can happen to a run, drawn from a seed. Pure: who carries it out is `inject`."""

import random
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "killed",
    "killed with another",
    "suspended 1 s",
    "suspended 6 s",
    "suspended 40 s",
    "hung",
    "disk full",
    "memory short",
    "newest snapshot damaged",
    "garbage",
    "truncated message",
    "message twice",
    "message replayed",
    "message of another schema",
    "message of another run",
    "forged fragment",
    "forged heartbeat",
    "lease taken by a stranger",
    "oversize message",
    "actors scaled",
]
PROCESSES = ("router", "learner", "actor", "evaluator", "supervisor")
SERVICES = ("router", "learner", "actor", "evaluator")

# How often, and whom it may meet; messages meet everybody who listens.
KINDS: dict[Kind, tuple[float, tuple[str, ...]]] = {
    "killed": (10, PROCESSES),
    "killed with another": (4, PROCESSES),
    "suspended 1 s": (4, PROCESSES),
    "suspended 6 s": (2, PROCESSES),
    "suspended 40 s": (0.2, SERVICES),
    "hung": (1, SERVICES),
    "disk full": (1, ("learner", "evaluator")),
    "memory short": (2, ("learner", "actor", "evaluator")),
    "newest snapshot damaged": (2, ("learner",)),
    "garbage": (2, ("",)),
    "truncated message": (2, ("",)),
    "message twice": (2, ("",)),
    "message replayed": (2, ("",)),
    "message of another schema": (1, ("",)),
    "message of another run": (2, ("",)),
    "forged fragment": (2, ("",)),
    "forged heartbeat": (2, ("",)),
    "lease taken by a stranger": (2, ("",)),
    "oversize message": (0.3, ("",)),
    "actors scaled": (4, ("",)),
}


@dataclass(frozen=True)
class Fault:
    """Something that happens once.

    Attributes:
        kind: what.
        target: to which process, of actors to any; empty for what meets no process alone.
        after: so many episodes after the run has gone on from the fault before.
        choice: for all else that is to be chosen.
    """

    kind: Kind
    target: str
    after: int
    choice: int


def drawn(seed: int, count: int, kinds: tuple[Kind, ...] = tuple(KINDS)) -> list[Fault]:
    """The same faults for the same seed, each of `kinds` at least once if there is room."""
    rng = random.Random(seed)
    weights = [KINDS[kind][0] for kind in kinds]
    chosen = list(kinds[:count]) + rng.choices(kinds, weights, k=max(0, count - len(kinds)))
    rng.shuffle(chosen)
    return [Fault(kind, rng.choice(KINDS[kind][1]), rng.randrange(3), rng.randrange(2**31)) for kind in chosen]
