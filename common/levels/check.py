"""Whether a distribution can be generated at all, known before any process starts."""

from railctl.common.levels.distributions import AnyLevels, LevelFiles
from railctl.common.levels.room import check_room
from railctl.common.levels.speeds import check_speeds


def check(name: str, levels: AnyLevels) -> None:
    """Refuse a distribution that can never be generated; in no time.

    Raises:
        ConfigError: in one line, field, value and remedy.
    """
    if not isinstance(levels, LevelFiles):
        check_room(name, levels)
        check_speeds(name, levels)
