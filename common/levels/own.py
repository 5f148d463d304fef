"""Level files of a distribution: found, read, divided into training and evaluation, and copied into the run.

No rails are on both sides: levels are divided by their rails, and training levels on the rails of an evaluation level
are left out. The same levels are always divided in the same way, in whatever order their files come.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from railctl.common.levels import files
from railctl.common.levels.check import check
from railctl.common.levels.distributions import AnyLevels, FoundLevels, LevelFiles
from railctl.common.levels.files import Groups, LevelFileError
from railctl.common.levels.level import Level
from railctl.common.levels.reading import read
from railctl.common.strict import ConfigError, brief

TRAINING, EVALUATION = "training", "evaluation"
LEVELS = "levels"  # the folder of a run with its copies


@dataclass(frozen=True)
class ReadLevels:
    """What the files of a distribution hold.

    Attributes:
        spec: the distribution, with what was found.
        training: levels, sorted by shape, then by content.
        evaluation: levels, likewise.
        left_out: what files say and levels cannot, a line each.
    """

    spec: LevelFiles
    training: list[Level]
    evaluation: list[Level]
    left_out: list[str] = field(default_factory=list)

    def save(self, folder: Path, name: str) -> Path:
        """Copy all levels into a folder, where `OwnLevels` finds them; returns the file."""
        folder.mkdir(parents=True, exist_ok=True)
        path = _file(folder, name)
        files.save(path, _groups(TRAINING, self.training) | _groups(EVALUATION, self.evaluation))
        return path

    def own(self, name: str) -> "OwnLevels":
        """The same levels, without a copy of them."""
        return OwnLevels(name, self.training, self.evaluation)


@dataclass(frozen=True)
class OwnLevels:
    """The levels of a run's own copy of its files."""

    name: str
    training_levels: Sequence[Level]
    evaluation_levels: Sequence[Level]

    @classmethod
    def read(cls, folder: Path, name: str, spec: LevelFiles) -> "OwnLevels":
        """Read the copy.

        Raises:
            ConfigError: it is not there, or not what the run began with.
        """
        path = _file(folder, name)
        try:
            groups = files.load(path)
        except LevelFileError as error:
            raise ConfigError(f"levels.{name}: {error}") from None
        training, evaluation = (_levels(groups, side) for side in (TRAINING, EVALUATION))
        if spec.found is None or digest_of(training, evaluation, spec) != spec.found.digest:
            raise ConfigError(f"levels.{name}: {path} does not hold the levels that the run began with: restore it")
        return cls(name, training, evaluation)

    def training(self, seed: int) -> Level:
        """The training level of a seed."""
        return self.training_levels[seed % len(self.training_levels)]

    def evaluation(self, index: int) -> Level:
        """The evaluation level of an index.

        Raises:
            ConfigError: there is none.
        """
        if not 0 <= index < len(self.evaluation_levels):
            count = len(self.evaluation_levels)
            raise ConfigError(f"levels.{self.name} has {count} evaluation levels: there is none of index {index}")
        return self.evaluation_levels[index]


def own_copy(run: Path, name: str) -> Path:
    """The file of a run with its copy of the levels of a distribution."""
    return _file(run / LEVELS, name)


def read_level_files(name: str, spec: LevelFiles, base: Path) -> ReadLevels:
    """Read and divide the levels of a distribution.

    Args:
        name: of the distribution, for errors.
        spec: says which files.
        base: the folder that relative paths start from.

    Raises:
        ConfigError: a file cannot be used, or one side has no levels; in one line, field, value and remedy.
    """
    found, left_out = _read_all(name, "files", spec.files, base)
    if isinstance(spec.evaluation, float):
        training, evaluation = divided(found, spec.evaluation)
        if not evaluation or not training:
            raise ConfigError(
                f"levels.{name}.files: {len(found)} levels on the same rails cannot be divided into training and "
                "evaluation: give more of them, or files of their own as evaluation"
            )
    else:
        evaluation, more = _read_all(name, "evaluation", spec.evaluation, base)
        left_out += more
        rails = {level.grid_hash for level in evaluation}
        training = [level for level in found if level.grid_hash not in rails]
        if not training:
            raise ConfigError(
                f"levels.{name}.files: all levels lie on the rails of evaluation levels: give others to train on"
            )
    training, evaluation = _sorted(training), _sorted(evaluation)
    levels = [*training, *evaluation]
    seen = FoundLevels(
        digest=digest_of(training, evaluation, spec),
        size=(max(level.grid.shape[0] for level in levels), max(level.grid.shape[1] for level in levels)),
        trains=max(level.n_trains for level in levels),
        training=len(training),
        evaluation=len(evaluation),
    )
    return ReadLevels(spec.model_copy(update={"found": seen}), training, evaluation, left_out)


def with_files_read(levels: Mapping[str, AnyLevels], base: Path) -> dict[str, AnyLevels]:
    """The same distributions, their level files read; what can never be generated is refused.

    Raises:
        ConfigError: as `read_level_files` and `check`.
    """
    found: dict[str, AnyLevels] = {}
    for name, spec in levels.items():
        check(name, spec)
        if isinstance(spec, LevelFiles) and spec.found is None:
            found[name] = read_level_files(name, spec, base).spec
        else:
            found[name] = spec
    return found


def divided(levels: Sequence[Level], share: float) -> tuple[list[Level], list[Level]]:
    """Training and evaluation levels, no rails on both sides; one is empty if all lie on the same.

    Rails go to the evaluation in the order of their hashes until it has its share of the levels.
    """
    wanted = max(1, round(share * len(levels)))
    by_rails: dict[int, list[Level]] = {}
    for level in levels:
        by_rails.setdefault(level.grid_hash, []).append(level)
    evaluation: list[Level] = []
    training: list[Level] = []
    for count, rails in enumerate(sorted(by_rails), start=1):
        is_last = count == len(by_rails)
        side = training if is_last or len(evaluation) >= wanted else evaluation
        side.extend(by_rails[rails])
    return training, evaluation


def digest_of(training: Iterable[Level], evaluation: Iterable[Level], spec: LevelFiles) -> str:
    """A digest of all levels, of which side they are on, and of the rules."""
    lines: list[str] = [spec.rules]
    lines += [f"{side} {level.content_hash}" for side, some in ((0, training), (1, evaluation)) for level in some]
    return hashlib.blake2b("\n".join(lines).encode(), digest_size=8).hexdigest()


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.npz"


def _read_all(name: str, key: str, patterns: Iterable[str], base: Path) -> tuple[list[Level], list[str]]:
    levels: dict[str, Level] = {}
    left_out = []
    for pattern in patterns:
        paths = _matching(f"levels.{name}.{key} {pattern}", pattern, base)
        if not paths:
            raise ConfigError(f"levels.{name}.{key} {pattern}: no such file in {base.resolve()}, where paths start")
        for path in paths:
            try:
                found = read(path)
            except (LevelFileError, OSError) as error:
                raise ConfigError(f"levels.{name}.{key} {error}") from None
            levels |= {level.content_hash: level for group in found.groups.values() for level in group}
            left_out += [f"{path}: {text}" for text in found.left_out]
    return list(levels.values()), left_out


def _matching(field: str, pattern: str, base: Path) -> list[Path]:
    path = Path(pattern)
    try:
        return sorted((base / path.anchor).glob(str(path.relative_to(path.anchor))))
    except (ValueError, IndexError, RecursionError):  # pathlib's words for a pattern that it does not take
        raise ConfigError(f"{field}: it is no pattern: use one as levels/*.pkl, or levels/**/*.pkl") from None
    except OSError as error:
        where = brief(str(error.filename), 200)
        raise ConfigError(f"{field}: {where}: {error.strerror}: use a pattern that does not lead there") from None


def _shape(level: Level) -> tuple[Any, ...]:
    return (*level.grid.shape, level.n_trains)


def _sorted(levels: Iterable[Level]) -> list[Level]:
    return sorted(levels, key=lambda level: (_shape(level), level.content_hash))


def _groups(side: str, levels: Sequence[Level]) -> Groups:
    """Groups of one shape each, in order."""
    parts = [list(some) for _, some in groupby(levels, _shape)]
    return {f"{side}_{number:04d}": some for number, some in enumerate(parts)}


def _levels(groups: Groups, side: str) -> list[Level]:
    return [level for name in sorted(groups) if name.startswith(f"{side}_") for level in groups[name]]
