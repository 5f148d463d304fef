"""Which runs and studies a page may ask for: those in the folder of all runs, and those that `railctl watch` named.

Names come from whoever reaches the port, so none of them is a path: each part is the name of a folder, below the folder
of all runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from railctl.analysis.study import StudyFolder, read_study
from railctl.common.folder import RunFolder
from railctl.common.strict import ConfigError, shortened
from railctl.deploy.launch import NAME_FORM
from railctl.deploy.listed import listed
from railctl.deploy.runs import all_runs, find_run, runs_root
from railctl.deploy.study.described import find_folder, shipped_studies

DEEPEST = 4  # parts of a name: STUDY/runs/RUN, and one more


@dataclass
class Catalogue:
    """Attributes: by name, what is not in the folder of all runs; and all that the command named, in its order."""

    runs: dict[str, RunFolder] = field(default_factory=dict)
    named: list[tuple[str, str]] = field(default_factory=list)  # kind and name

    def run(self, name: str) -> RunFolder:
        """The run of this name.

        Raises:
            ConfigError: there is none.
        """
        if name in self.runs:
            return self.runs[name]
        _check(name)
        folder = find_run(name)
        if folder.path != runs_root() / name:  # found from where the server was started
            raise ConfigError(f"no run named {name} in {runs_root()}")
        return folder

    def study(self, name: str) -> StudyFolder:
        """The study of this name; raises as `run`."""
        _check(name)
        folder = StudyFolder(runs_root() / name)
        if not folder.study_file.is_file():
            raise ConfigError(f"no study named {name} in {runs_root()}")
        return folder

    def documents(self) -> dict[str, Any]:
        """All that there is, for a list."""
        runs = [listed(folder)._asdict() for folder in all_runs()]
        known = {run["run"] for run in runs}
        runs += [listed(folder)._asdict() | {"run": name} for name, folder in self.runs.items() if name not in known]
        return {"runs": runs, "studies": _studies(), "named": self.named, "folder": str(runs_root())}


def catalogue_of(names: Sequence[str]) -> Catalogue:
    """The catalogue of a command that was given these names or paths of runs, or names of studies.

    Raises:
        ConfigError: there is no such run or study.
    """
    catalogue = Catalogue()
    for name in dict.fromkeys(names):
        if (runs_root() / name / "study.yaml").is_file():
            catalogue.named.append(("study", name))
            continue
        if name in shipped_studies():
            find_folder(name)  # which says how to start it
        folder = find_run(name)
        called = _called(folder)
        if not _is_below_root(folder):
            catalogue.runs[called] = folder
        catalogue.named.append(("run", called))
    return catalogue


def _is_below_root(folder: RunFolder) -> bool:
    return folder.path.resolve().is_relative_to(runs_root().resolve())


def _called(folder: RunFolder) -> str:
    """The name of a run in addresses: where it is below the folder of all runs, or that of its own folder."""
    if _is_below_root(folder):
        return str(folder.path.resolve().relative_to(runs_root().resolve()))
    return folder.path.resolve().name


def _studies() -> list[dict[str, Any]]:
    files = sorted(runs_root().glob("*/study.yaml"), key=lambda path: path.stat().st_mtime)
    return [_study(file) for file in files]


def _study(file: Path) -> dict[str, Any]:
    name = file.parent.name
    try:
        study = read_study(file)
    except ConfigError as error:
        return {"study": name, "wrong": str(error)}
    contenders = [contender.name for contender in study.contenders]
    runs = len(contenders) * len(study.levels) * len(study.seeds)
    return {"study": name, "contenders": contenders, "levels": list(study.levels), "runs": runs, "wrong": ""}


def _check(name: str) -> None:
    """Raises ConfigError if it is no name of something below the folder of all runs."""
    parts = name.split("/")
    if len(parts) > DEEPEST or not all(NAME_FORM.fullmatch(part) for part in parts):
        raise ConfigError(f"{shortened(name)} is no name of a run or study: use one of railctl list")
