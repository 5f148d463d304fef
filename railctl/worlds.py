"""Worlds as environments of PettingZoo."""

from pathlib import Path
from typing import Any

from railctl.common.levels.own import LEVELS
from railctl.common.levels.supply import LevelSupply
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.common.world import WorldSpec, checked_world, chosen_levels, read_world
from railctl.deploy.runs import Failed
from railctl.given import text_of
from railctl.policies import Policy
from railctl.trained import Run

KEYS = ("observation", "decisions", "reward", "interlocking", "patience")  # of a run file, beside its levels
FILES = (".yaml", ".yml")


def environment(where: str | Path | Policy | Run, level: str | None, render_mode: str | None, settings: Any) -> Any:
    """See `railctl.make_env`."""
    try:
        from railctl.adapters.pettingzoo_env import TrainsEnv  # noqa: PLC0415  (it is an extra)
    except ModuleNotFoundError as error:
        raise Failed(f"the package {error.name} is missing: pip install 'railctl[pettingzoo]'") from None
    chosen = {key: _spelled_out(key, value) for key, value in settings.items()}
    level = text_of("level", level)
    if isinstance(where, (Policy, Run)):
        world, name = _known_world(where, level, chosen)
        return TrainsEnv(name, world=world, levels=_supply(where, world), render_mode=render_mode)
    if str(where).endswith(FILES):
        if not chosen:
            return TrainsEnv(level, run_file=where, render_mode=render_mode)
        raise ConfigError(f"{where} says what the world is: leave {', '.join(chosen)} out, or change the file")
    name = str(where)
    if level is not None:
        raise ConfigError(f"level={level!r}: levels are named by where={name!r} already: leave one out")
    world = read_world({"levels": chosen_levels({name: 1.0}, {})} | chosen, Path())
    return TrainsEnv(name, world=world, render_mode=render_mode)


def _known_world(where: Policy | Run, level: str | None, chosen: dict[str, Any]) -> tuple[WorldSpec, str]:
    """The world of a policy or run, changed, and which of its levels are played; others that ship may be."""
    config = where.config
    name = next(iter(config.mix)) if level is None else level
    levels = config.world.model_dump(mode="json")["levels"]
    if name not in levels:
        levels = chosen_levels({name: 1.0}, {})
    world = checked_world(config.world.model_dump(mode="json") | {"levels": levels} | chosen)
    if world.n_features != config.world.n_features and not chosen:
        raise ConfigError(
            f"level {name}: trains see {world.n_features} numbers there, and {where.name} knows "
            f"{config.world.n_features}: play levels of the size that it was trained on"
        )
    return world, name


def _supply(where: Policy | Run, world: WorldSpec) -> LevelSupply:
    folder = where.path.parent.parent if isinstance(where, Policy) else where.path
    return LevelSupply(world.levels, kept=folder / LEVELS)


def _spelled_out(key: str, value: Any) -> Any:
    """A setting as a world takes it; raises ConfigError for what is none."""
    if key not in KEYS:
        raise ConfigError(f"unknown setting {shortened(key)}{nearest(key, list(KEYS))}")
    return {"kind": value} if key in ("observation", "reward") and isinstance(value, str) else value
