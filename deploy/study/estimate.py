"""What a study takes: seconds an episode, measured on its own runs or in one process, and sums of those.

What is measured is what it takes while as many runs go on at once as in the study itself. Levels that are generated
ahead of time, references and the report are left out: they take minutes.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple

from railctl.analysis.study import FinalEvaluation, Study, StudyFolder
from railctl.common.folder import RunFolder
from railctl.common.records.rows import EpisodeRow, EvaluationRow
from railctl.common.rows import DamagedRows, read_rows
from railctl.common.strict import ConfigError
from railctl.deploy.follow import outcome_of
from railctl.deploy.study.calibration import Figures, kept
from railctl.deploy.study.progress import RunProgress, StudyProgress

BESIDE_S = 0.0015  # of a fragment, beside acting and learning: weights, rows, snapshots; two runs on two cores
STARTING_S = 5.0  # a cluster, until its first episode, and from its last one to its end
SCORING_STARTS_S = 3.0  # a process that scores a network, until its first level
INTERRUPTION_S = 60.0  # between two episodes: the run was not going on

Cell = tuple[str, str]  # contender and level
Source = Literal["run", "calibration"]


class Rate(NamedTuple):
    """What one run of a contender on a level takes."""

    episode_s: float
    level_s: float  # to score a network on one level
    run_bytes: int
    source: Source
    episodes: int  # that were counted

    def run_s(self, episodes: int, evaluation: FinalEvaluation) -> float:
        """To train so many episodes, and to score the network."""
        return STARTING_S + episodes * self.episode_s + self.scoring_s(evaluation)

    def scoring_s(self, evaluation: FinalEvaluation) -> float:
        return SCORING_STARTS_S + evaluation.episodes * self.level_s


def measured(folder: StudyFolder, progress: StudyProgress) -> dict[Cell, Rate]:
    """What is known: of each contender and level the first run that is over, else what was measured for the plan."""
    rates, figures = {}, kept(folder)
    for cell, runs in progress.cells().items():
        over = next((folder.run(run.run) for run in runs if run.state in ("trained", "done")), None)
        short = figures.get(runs[0].run.name)
        rate = None if over is None else _rate(over, progress.study)
        if rate is None and short is not None:
            rate = expected(short)
        if rate is not None:
            rates[cell] = rate
    return rates


def expected(figures: Figures) -> Rate:
    """What a run takes of which there are but figures without messages."""
    return Rate(
        episode_s=figures.episode_s + figures.fragments * BESIDE_S,
        level_s=figures.level_s,
        run_bytes=figures.run_bytes,
        source="calibration",
        episodes=figures.episodes,
    )


def _rate(path: Path, study: Study) -> Rate | None:
    place = RunFolder(path)
    if outcome_of(place)[0] != "finished":
        return None
    try:
        episodes = read_rows(place.episodes_file, EpisodeRow)
        evaluations = read_rows(place.evaluations_file, EvaluationRow)
        every = place.config().evaluation.every_episodes
    except (ConfigError, DamagedRows):
        return None
    if len(episodes) < 2 or not evaluations:
        return None
    last = evaluations[-1]
    seconds = episode_seconds([row.trained_unix_s for row in episodes])
    size = _bytes(place, study.episodes / len(episodes), -(-study.episodes // every))
    return Rate(seconds, last.evaluating_s / last.levels, size, "run", len(episodes))


def episode_seconds(trained_unix_s: Sequence[float]) -> float:
    """Seconds an episode from the times of at least two, interruptions left out.

    >>> episode_seconds([0.0, 1.0, 3.0, 1003.0, 1006.0])
    2.0
    """
    gaps = [after - before for before, after in pairwise(trained_unix_s)]
    kept = [gap for gap in gaps if gap < INTERRUPTION_S]
    return sum(kept) / len(kept) if kept else sum(gaps) / len(gaps)


def _bytes(place: RunFolder, times: float, checkpoints: int) -> int:
    """What a run leaves behind that has `times` as many episodes; its snapshots are deleted when it is scored."""
    rows = [place.episodes_file, place.metrics_file, *place.tensorboard.glob("*")]
    networks = [path.stat().st_size for path in place.checkpoints.glob("*.safetensors")]
    rest = [place.curve_file, *place.logs.glob("*")]
    return round(_sum(rows) * times + max(networks, default=0) * checkpoints + _sum(rest))


def _sum(paths: Iterable[Path]) -> int:
    return sum(path.stat().st_size for path in paths if path.is_file())


def run_seconds(rates: Mapping[Cell, Rate], study: Study) -> dict[Cell, float]:
    """What a whole run of each cell takes that something is known of."""
    return {cell: rate.run_s(study.episodes, study.evaluation) for cell, rate in rates.items()}


def seconds_left(progress: StudyProgress, rates: Mapping[Cell, Rate], cores: int) -> float | None:
    """What is left to do, by so many cores; of what nothing is known, the mean of what is known.

    None if nothing is known. No less than the longest run alone.
    """
    if not rates:
        return None
    study = progress.study
    lefts = [_left(run, study, rates) for run in progress.runs]
    known = [left for left in lefts if left is not None]
    mean = sum(rate.run_s(study.episodes, study.evaluation) for rate in rates.values()) / len(rates)
    lefts_s = [*known, *[mean] * (len(lefts) - len(known))]
    return max([sum(lefts_s) / cores, *lefts_s])


def _left(run: RunProgress, study: Study, rates: Mapping[Cell, Rate]) -> float | None:
    if run.state == "done":
        return 0.0
    rate = rates.get(run.run[:2])
    if rate is None:
        return None
    if run.state == "trained":
        return rate.scoring_s(study.evaluation)
    return rate.run_s(study.episodes - run.episodes, study.evaluation)
