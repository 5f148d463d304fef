"""Drawing a level of any distribution: a pure function of its settings and a seed."""

from common.levels.distributions import Generated, LegacyLevels
from common.levels.level import Level


class InfeasibleLevelError(RuntimeError):
    """The generator's draws gave a train no way to its target."""


def generate(levels: Generated, seed: int) -> Level:
    """The level of `seed`: the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of several derived seeds gave a level whose trains can all arrive.
    """
    if isinstance(levels, LegacyLevels):
        from common.levels import legacy  # noqa: PLC0415  (flatland takes seconds to import, and a full bank spares it)

        return legacy.generate(levels, seed)
    from common.levels import stock  # noqa: PLC0415

    return stock.generate(levels, seed)
