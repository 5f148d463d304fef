"""The distributions that ship with the project: see `common.levels.distributions.shipped`."""

from railctl.common.levels.distributions import shipped
from railctl.common.levels.generate import generate as generate_any
from railctl.common.levels.level import Level


def generate(name: str, seed: int) -> Level:
    """The level of `seed` of one of them."""
    return generate_any(shipped()[name], seed)
