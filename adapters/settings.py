"""What an environment plays: a world, and the shares of its level distributions."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from railctl.common.config import upgraded
from railctl.common.levels.distributions import shipped
from railctl.common.levels.own import with_files_read
from railctl.common.mapping_file import read_mapping
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.common.world import WorldSpec, chosen_levels, read_world

KEYS = ("observation", "decisions", "reward", "interlocking", "patience")  # of a run file, beside its levels


@dataclass(frozen=True)
class Setting:
    """What an environment plays.

    Attributes:
        world: the world; its level files were read.
        mix: shares of its distributions.
        base: where relative paths of level files begin.
    """

    world: WorldSpec
    mix: Mapping[str, float]
    base: Path = Path()

    @classmethod
    def of_study(cls, depth: int | None, decisions: Any) -> "Setting":
        """All levels that ship, under the study's conditions but for what is given.

        Raises:
            ConfigError: something of it cannot be.
        """
        given = {"observation": None if depth is None else {"kind": "tree", "depth": depth}, "decisions": decisions}
        chosen = {key: value for key, value in given.items() if value is not None}
        world = read_world({"levels": chosen_levels(shipped(), {})} | chosen, Path())
        return cls(world, {"easy": 1.0})

    @classmethod
    def of_world(cls, world: WorldSpec, base: Path = Path()) -> "Setting":
        """A world, all distributions alike."""
        share = 1 / len(world.levels)
        read = world.model_copy(update={"levels": with_files_read(world.levels, base)})
        return cls(read, dict.fromkeys(world.levels, share), base)

    @classmethod
    def of_run_file(cls, path: Path) -> "Setting":
        """The world and the mix of a run file, as `railctl up -f` takes it; what it says of learning is left out.

        Raises:
            ConfigError: it cannot be read, or something in it is wrong.
        """
        data = upgraded(read_mapping(path, "give an existing run file", "mix: {easy: 1}"))
        mix = data.get("mix", {data.get("level", "easy"): 1.0})
        if not isinstance(mix, dict) or not mix:
            raise ConfigError(f"mix: input should be a valid dictionary, not {shortened(mix)}")
        chosen = {key: data[key] for key in KEYS if key in data}
        for key in ("observation", "reward"):
            if isinstance(chosen.get(key), str):
                chosen[key] = {"kind": chosen[key]}
        world = read_world({"levels": chosen_levels(mix, data.get("levels", {}))} | chosen, path.parent)
        return cls(world, mix, path.parent)

    def only(self, name: str) -> "Setting":
        """The same world, but only one of its distributions is played.

        Raises:
            ConfigError: there is none of this name.
        """
        if name not in self.world.levels:
            raise ConfigError(f"unknown level {shortened(name)}{nearest(str(name), list(self.world.levels))}")
        return Setting(self.world, {name: 1.0}, self.base)

    @property
    def most_trains(self) -> int:
        """Of all levels that are played."""
        return max(self.world.levels[name].bounds.trains for name in self.mix)


def setting_of(run_file: Path | str | None, world: WorldSpec | None, depth: Any, decisions: Any) -> Setting:
    """What is played according to the arguments of an environment.

    Raises:
        ConfigError: they contradict each other, or something in them is wrong.
    """
    if run_file is None and world is None:
        return Setting.of_study(depth, decisions)
    for argument, value in (("depth", depth), ("decisions", decisions)):
        if value is not None:
            raise ConfigError(f"{argument} {value}: the world says it already, leave it out")
    if run_file is None or world is None:
        return Setting.of_world(world) if world is not None else Setting.of_run_file(Path(str(run_file)))
    raise ConfigError("run_file and world are both given: leave one out")
