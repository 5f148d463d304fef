"""What update rules can be told: a file a rule, each with a class `Settings`. How they learn is the learner's business.

Actors and evaluators need to know it too: which network acts, and how it explores.
"""

import importlib
import pkgutil
from functools import cache
from typing import cast

from railctl.common.rules.settings import RuleSettings
from railctl.common.strict import ConfigError, nearest, shortened

_SHARED = ("settings", "replay", "values", "policies")  # what several rules are made of


@cache
def rules() -> tuple[str, ...]:
    """The names of all update rules."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return tuple(name for name in names if name not in _SHARED)


def settings_of(rule: str) -> type[RuleSettings]:
    """The settings model of a rule.

    Raises:
        ConfigError: there is no such rule.
    """
    if rule not in rules():
        raise ConfigError(f"unknown rule {shortened(rule)}{nearest(str(rule), list(rules()))}")
    return cast("type[RuleSettings]", importlib.import_module(f"railctl.common.rules.{rule}").Settings)
