"""What `railctl evaluate` does when it is given the name of a reference policy instead of a checkpoint."""

from pathlib import Path
from typing import Any, get_args

from common.config import ConfigError
from common.study import Reference

REFERENCE_SCORER = "services.evaluator.references"
REFERENCES: tuple[str, ...] = get_args(Reference)
DRAWING = ("random", "planner")


def check_reference(policy: str, levels: Path | None, seed: int | None, orders: int | None, *, sample: bool) -> None:
    """Raise ConfigError if an option is of no use to the policy."""
    if sample:
        raise ConfigError(f"--sample: {policy} is no network with probabilities to draw from: leave it out")
    if orders is not None and policy != "planner":
        raise ConfigError(f"--orders: only planner tries orders of trains, {policy} does not: leave it out")
    if orders is not None and orders < 1:
        raise ConfigError(f"--orders {orders}: use a number above 0")
    if levels is not None and seed is not None and policy not in DRAWING:
        raise ConfigError(f"--levels and --seed: {policy} on given levels draws nothing, leave --seed out")


def heading(result: dict[str, Any]) -> str:
    """What was played, in a line.

    >>> heading({"policy": "planner", "orders": 50})
    'planner, the best of 50 orders'
    >>> heading({"checkpoint": "best.safetensors", "algorithm": "sil", "episode": 7, "mode": "greedy"})
    'best.safetensors: sil after 7 episodes, greedy'
    """
    policy = result.get("policy")
    if policy is None:
        return f"{result['checkpoint']}: {result['algorithm']} after {result['episode']} episodes, {result['mode']}"
    notes = {"planner": f", the best of {result['orders']} orders", "alone": ": every train as if there were no others"}
    return str(policy) + notes.get(policy, "")
