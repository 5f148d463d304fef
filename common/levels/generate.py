"""Drawing a level of any distribution: a pure function of its settings and a seed."""

from railctl.common.levels import legacy, stock
from railctl.common.levels.distributions import Generated, LegacyLevels
from railctl.common.levels.level import Level


def generate(levels: Generated, seed: int) -> Level:
    """The level of `seed`: the same in every process, whatever the global generators hold.

    Raises:
        InfeasibleLevelError: none of several derived seeds gave a level whose trains can all arrive.
        TracksLeaveGridError: tracks reach beyond the grid.
    """
    return legacy.generate(levels, seed) if isinstance(levels, LegacyLevels) else stock.generate(levels, seed)
