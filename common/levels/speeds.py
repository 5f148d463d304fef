"""Speeds as flatland-rl 4.3.0 takes them: exact fractions of a cell a step, without the library."""

from decimal import Decimal
from fractions import Fraction
from math import lcm

from numpy import isclose

from railctl.common.levels.distributions import Generated, StockLevels
from railctl.common.strict import ConfigError

NEAR = 1e-2  # of the inverse of a whole number, relative to it
LARGEST_UNIT = 1 << 20  # the common denominator of the speeds of a level, at most


def speed_fraction(speed: float | Fraction) -> Fraction:
    """The library's `_pseudo_fractional` of a speed above 0 and at most 1: near 1 / n it is just that.

    >>> speed_fraction(0.33), speed_fraction(0.4), speed_fraction(1.0)
    (Fraction(1, 3), Fraction(2, 5), Fraction(1, 1))

    Raises:
        ValueError: it is no such speed.
    """
    if isinstance(speed, Fraction):
        return speed
    speed = float(speed)
    if not 0 < speed <= 1:
        raise ValueError(f"a speed of {speed:g}, which is not above 0 and at most 1")
    if isclose(speed % 1, 0.0):
        return Fraction(int(speed))
    if isclose(1 / round(1 / speed), speed, atol=NEAR):
        return Fraction(1, round(1 / speed))
    return Fraction(Decimal(str(speed)))


def check_speeds(name: str, levels: Generated) -> None:
    """Refuse speeds that the worlds cannot run.

    Raises:
        ConfigError: in one line, field, value and remedy.
    """
    speeds = levels.speeds if isinstance(levels, StockLevels) else None
    if speeds is not None and lcm(*(speed_fraction(speed).denominator for speed in speeds)) > LARGEST_UNIT:
        raise ConfigError(
            f"levels.{name}.speeds {', '.join(f'{speed:g}' for speed in speeds)}: their common denominator exceeds "
            f"{LARGEST_UNIT}: use rounder ones, as 0.5 or 0.25"
        )
