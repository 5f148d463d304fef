"""railctl from Python: train dispatchers, evaluate them, and step their worlds.

>>> import railctl
>>> policy = railctl.load_policy("pretrained/dispatch-easy")
>>> result = railctl.evaluate(policy, level="easy", episodes=5)
>>> result.arrived_share
1.0

`docs/python.md` has the whole of it. Nothing heavy is imported before it is used.

All packages lie in this one, in a checkout by links: an installation brings one name, which neither shadows nor is
shadowed by a user's own `common` or `services`.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from railctl.api import evaluate, load_policy, make_env, open_run, runs, train
    from railctl.common.strict import ConfigError
    from railctl.deploy.runs import Failed
    from railctl.policies import Policy
    from railctl.results import Evaluation
    from railctl.trained import Run

__all__ = [
    "ConfigError",
    "Evaluation",
    "Failed",
    "Policy",
    "Run",
    "evaluate",
    "load_policy",
    "make_env",
    "open_run",
    "runs",
    "train",
]

_HOMES = {
    "ConfigError": "railctl.common.strict",
    "Evaluation": "railctl.results",
    "Failed": "railctl.deploy.runs",
    "Policy": "railctl.policies",
    "Run": "railctl.trained",
} | dict.fromkeys(("evaluate", "load_policy", "make_env", "open_run", "runs", "train"), "railctl.api")


def __getattr__(name: str) -> Any:
    """A name of the API, imported when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module railctl has no attribute {name}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
