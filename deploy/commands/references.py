"""What `railctl evaluate` does when it is given the name of a reference policy instead of a checkpoint."""

from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from railctl.common.requests import DRAWING, MOST_ORDERS, PLANNING, Reference
from railctl.common.strict import ConfigError
from railctl.deploy.output import counted
from railctl.deploy.runs import PRETRAINED, find_checkpoint

REFERENCE_SCORER = "railctl.services.evaluator.references"
REFERENCES: tuple[str, ...] = get_args(Reference)


def found_checkpoint(name: str) -> Path:
    """`find_checkpoint`, which in its complaint thinks of the policies, too."""
    try:
        return find_checkpoint(name)
    except ConfigError as error:
        close = get_close_matches(name, REFERENCES, n=1)
        hint = f"; did you mean the policy {close[0]}?" if close else ""
        raise ConfigError(f"{error}{hint}") from None


def check_reference(policy: str, draws: int | None, orders: int | None, *, sample: bool | None) -> None:
    """Raise ConfigError if an option is of no use to the policy."""
    if sample is not None:
        given = "--sample" if sample else "--greedy"
        raise ConfigError(f"{given}: {policy} is no network whose actions could be drawn, or the best: leave it out")
    check_orders(policy, orders)
    if draws is not None and policy not in DRAWING:
        raise ConfigError(f"--draws {draws}: {policy} draws nothing, leave it out")


def check_orders(policy: str, orders: int | None) -> None:
    """Raise ConfigError if orders of trains are of no use to a policy, or too many or few."""
    if orders is not None and policy not in PLANNING:
        raise ConfigError(f"--orders: only planners try orders of trains, {policy} does not: leave it out")
    if orders is not None and not 1 <= orders <= MOST_ORDERS:
        raise ConfigError(f"--orders {orders}: use 1 to {MOST_ORDERS}")


def heading(result: dict[str, Any]) -> str:
    """What was played, in a line.

    >>> heading({"policy": "planner", "orders": 50})
    'planner, the best of 50 orders'
    >>> heading({"checkpoint": "best.safetensors", "algorithm": "sil", "episode": 7, "mode": "greedy"})
    'best.safetensors: sil after 7 episodes, greedy'
    """
    policy = result.get("policy")
    if policy is None:
        trained = f"{result['algorithm']} after {counted(result['episode'], 'episode')}, {result['mode']}"
        path = Path(result["checkpoint"])
        name = f"{PRETRAINED.name}/{path.stem}" if path.parent == PRETRAINED else path
        return f"{name}: {trained}"
    if policy in PLANNING:
        return f"{policy}, the best of {counted(result['orders'], 'order')}"
    return f"{policy}: every train as if there were no others" if policy == "alone" else str(policy)
