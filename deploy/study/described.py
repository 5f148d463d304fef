"""From the name of a study to its description, its folder, and the checked configuration of every run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from railctl.analysis.study import Contender, PlannedRun, Study, StudyFolder, planned_runs, read_study
from railctl.common.config import PATHS, RunConfig
from railctl.common.folder import write_atomically
from railctl.common.levels.distributions import AnyLevels, StockLevels
from railctl.common.plain_yaml import dump_yaml
from railctl.common.strict import ConfigError, flat, nearest
from railctl.deploy.resolve import merge, preset_of, resolve, spelled_out
from railctl.deploy.runs import Failed, runs_root
from railctl.deploy.whole_paths import levels_with_whole_paths

SHIPPED = Path(__file__).parents[1] / "studies"
OF_THE_STUDY = ("algorithm", "rule", "level", "mix", "seed", "episodes")  # it gives them to its runs itself
OF_THE_MACHINE = {  # keys of cluster, and why a study's runs have none of them
    "cores": "runs are packed onto the cores together",
    "listen": "runs go on beside each other, and would listen at one address",
    "keys": "runs go on beside each other, and none of them listens for other machines",
}
OF_ALL = ("levels",)  # or contenders would not learn on the same ones


def shipped_studies() -> list[str]:
    """The names of the studies that are shipped."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def find_study(name: str) -> Study:
    """The study of this name, or in the file of this path.

    Raises:
        ConfigError: there is none, or it is wrong.
    """
    if Path(name).suffix in {".yaml", ".yml"}:
        return _found_from_anywhere(read_study(Path(name)), Path(name).parent.resolve())
    if name in shipped_studies():
        return read_study(SHIPPED / f"{name}.yaml")
    return read_study(find_folder(name).study_file)


def _found_from_anywhere(study: Study, base: Path) -> Study:
    """The study with paths of level files that start from the root: it goes on wherever somebody is."""
    levels = study.settings.get("levels")
    if not isinstance(levels, dict):
        return study
    whole = levels_with_whole_paths(levels, base)
    return study.model_copy(update={"settings": study.settings | {"levels": whole}})


def named(study: Study, name: str | None) -> Study:
    """The study under another name, if one is given.

    Raises:
        ConfigError: it is no name.
    """
    if name is None:
        return study
    try:
        return Study.model_validate(study.model_dump() | {"name": name})
    except ValidationError:
        raise ConfigError(f"--name {name!r}: use letters, digits, '_', '.', '+' and '-', at most 40") from None


def find_folder(name: str) -> StudyFolder:
    """The folder of a study that has been started.

    Raises:
        ConfigError: there is none of this name.
    """
    given = name
    if is_file := Path(given).suffix in {".yaml", ".yml"}:
        name = read_study(Path(given)).name
    folder = StudyFolder(runs_root() / name)
    if folder.study_file.exists():
        return folder
    if is_file or name in shipped_studies():
        remedy = f"start it with railctl study run {given}"
        raise ConfigError(f"study {name} has not been started in {runs_root()}: {remedy}")
    started = [path.parent.name for path in runs_root().glob("*/study.yaml")]
    hint = nearest(name, [*dict.fromkeys([*shipped_studies(), *started])])
    raise ConfigError(f"no study named {name!r}{hint}; or give a file that ends in .yaml")


def configurations(study: Study, cores: int) -> dict[PlannedRun, RunConfig]:
    """The configuration of every run, all of them checked.

    Raises:
        ConfigError: one line that names the contender, the level, and what is wrong.
    """
    of_cell: dict[tuple[str, str], RunConfig] = {}
    _check_settings("settings", study.settings)
    for contender in study.contenders:
        field = f"contenders.{contender.name}.settings"
        _check_settings(field, contender.settings)
        for key in OF_ALL:
            if key in contender.settings:
                raise ConfigError(f"{field}.{key}: all contenders have the same ones, give them under settings.{key}")
        for level in study.levels:
            try:
                config = of_cell[contender.name, level] = resolve(_given(study, contender, level, cores))
            except ConfigError as error:
                raise ConfigError(f"contender {contender.name} on {level}: {error}") from None
            _check_evaluation(study, level, config.world.levels[level].evaluation_levels)
            _check_references(study, level, config.world.levels[level])
    return {run: of_cell[run.contender, run.level].model_copy(update={"seed": run.seed}) for run in planned_runs(study)}


def _given(study: Study, contender: Contender, level: str, cores: int) -> dict[str, Any]:
    rule = str(preset_of(contender.algorithm)["rule"])
    settings = merge(spelled_out(study.settings, rule), spelled_out(contender.settings, rule))
    return merge(
        settings,
        {
            "algorithm": contender.algorithm,
            "level": level,
            "seed": study.seeds[0],
            "episodes": study.episodes,
            "cluster": {"cores": cores},
        },
    )


def _check_evaluation(study: Study, level: str, kept: int) -> None:
    if study.evaluation.episodes > kept:
        raise ConfigError(
            f"evaluation.episodes {study.evaluation.episodes}: {level} keeps only {kept} from training, use no more"
        )


def _check_references(study: Study, level: str, levels: AnyLevels) -> None:
    if "planner" not in study.references or not isinstance(levels, StockLevels):
        return
    if levels.malfunctions is not None or set(levels.speeds or {1: 1}) != {1}:
        raise ConfigError(
            f"references: planner plans for trains of speed 1 that never break down, unlike {level}'s: leave it out"
        )


def _check_settings(field: str, settings: Mapping[str, Any]) -> None:
    for key in OF_THE_STUDY:
        if key in settings:
            raise ConfigError(f"{field}.{key}: the study says it for all its runs, leave it out")
    for name, file in PATHS.items():
        start = settings.get(name)
        path = start.get(file) if isinstance(start, Mapping) else start
        if isinstance(path, str) and not Path(path).is_absolute():
            raise ConfigError(f"{field}.{name} {path}: a study runs from anywhere, give the whole path")
    cluster = settings.get("cluster")
    for key, why in OF_THE_MACHINE.items():
        if isinstance(cluster, dict) and key in cluster:
            raise ConfigError(f"{field}.cluster.{key}: {why}, leave it out")


def save_study(folder: StudyFolder, study: Study) -> None:
    """Write a study down when it starts; one that has been started stays as it is.

    Raises:
        ConfigError: the folder is that of a run, or of a study that differs.
        Failed: the folder cannot be made.
    """
    if (folder.path / "config.yaml").exists():
        raise ConfigError(f"{folder.path} is a run: give the study another --name")
    if folder.study_file.exists():
        _compare(folder, read_study(folder.study_file), study)
        return
    text = dump_yaml(study.model_dump(mode="json"))
    try:
        for path in (folder.path, folder.runs, folder.path / "evaluations", folder.path / "references"):
            path.mkdir(parents=True, exist_ok=True)
        write_atomically(folder.study_file, text)
    except OSError as error:
        raise Failed(
            f"cannot create {folder.path}: {error.strerror}: set RAILCTL_RUNS to a folder that you may write"
        ) from None


def _compare(folder: StudyFolder, saved: Study, study: Study) -> None:
    before, now = _flat(saved), _flat(study)
    for field in dict.fromkeys([*before, *now]):
        if before.get(field) != now.get(field):
            raise ConfigError(
                f"study {saved.name} was started with {field} {before.get(field)}, not {now.get(field)}: "
                f"give the changed one another --name, or delete {folder.path}"
            )


def _flat(study: Study) -> dict[str, Any]:
    plain = study.model_dump(mode="json")
    contenders = {contender["name"]: contender for contender in plain["contenders"]}
    order = list(contenders)
    return flat(plain | {"contenders": contenders}) | {"order of contenders": order}
