"""How much faster a whole training run is than the loop that a student would write: `railctl bench loop`.

Both train `dddqn` by its preset, serially, on the same levels in the same order. Ours is a run as a user starts it,
`railctl up` at lag 0, where the learner acts itself; levels are generated as they come, there is no bank. Theirs is
`tools.bench.plain_training`: one process with one thread, flatland-rl 4.3.0 with the study's rules, and torch, eager.

Network, batch size and exploration are the same, and so are updates an environment step, which is checked. The draws
are others, and so are trees (those of 4.3.0) and curves: rates are compared, not what was learned. They are taken from
one trained episode to the last, and leave out the first tenth, and all episodes up to the first that has an update, as
before that the replay holds less than a batch. Both count the decisions of trains that can choose, and no others.

Times are those of the clock: ours has several processes, of which one does nearly all of the work at lag 0. An update
of theirs is drawing the batch and learning from it; of ours, making transitions and adding them to the replay, too.

"whole run" is from the command to its end: of ours with the start of its processes, its files, and the evaluation of
its checkpoint on 50 levels. Of theirs it is the loop alone: it is given the levels, and pays neither for imports nor
for an evaluation. So this ratio grows with the number of episodes. Theirs does pay for saying to 4.3.0 what does as
2.2.2 did, 2 % of its time, and for the trees of all trains in every step, as the library gives them.
"""

import gc
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import torch

from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder
from railctl.common.levels.distributions import shipped
from railctl.common.levels.supply import LevelSupply
from railctl.common.records.rows import EpisodeRow, MetricRow
from railctl.common.rows import read_rows
from railctl.common.task import FAILED
from railctl.tools.bench.cluster import WARM_UP
from railctl.tools.bench.launching import NAME, ended_with_us, railctl
from railctl.tools.bench.measuring import DisagreementError, Parser, Sample, count, one_of, row_of, show
from railctl.tools.bench.plain_training import PlainTraining, Trained, settings_of

ALGORITHM = "dddqn"
FIGURES = (("steps", "steps/s"), ("decisions", "decisions/s"), ("episodes", "episodes/s"), ("update", "ms/update"))


class Training(NamedTuple):
    """A run that has ended: its episodes, and how long it took."""

    trained: list[Trained]
    wall_s: float


def train_ours(level: str, episodes: int) -> tuple[Training, RunConfig, list[EpisodeRow]]:
    """A run, what it was told, and its episodes' rows.

    Raises:
        DisagreementError: it failed.
    """
    with tempfile.TemporaryDirectory(prefix="railctl-bench-") as folder:
        began = time.perf_counter()
        told = ("--algorithm", ALGORITHM, "--level", level, "--episodes", str(episodes), "--name", NAME)
        with ended_with_us(folder):
            railctl(folder, "up", *told)
        wall_s = time.perf_counter() - began
        run = RunFolder(Path(folder) / NAME)
        rows, metrics = read_rows(run.episodes_file, EpisodeRow), read_rows(run.metrics_file, MetricRow)
        trained = [
            Trained(row.trained_unix_s, row.steps, row.decisions, int(of.metrics["updates"]), of.metrics["learning_s"])
            for row, of in zip(rows, metrics, strict=True)
        ]
        return Training(trained, wall_s), run.config(), rows


def train_theirs(config: RunConfig, rows: Sequence[EpisodeRow]) -> Training:
    """The plain loop on the levels of these rows."""
    supply, training = LevelSupply(config.world.levels), PlainTraining(config)
    levels = [supply.training(row.level, row.seed) for row in rows]
    with warnings.catch_warnings(action="ignore"), redirect_stdout(StringIO()):  # what the library says there
        began = time.perf_counter()
        trained = [training.train(level) for level in levels]
        return Training(trained, time.perf_counter() - began)


def samples(name: str, ours: Training, theirs: Training, learn_every_steps: int) -> list[Sample]:
    """What a repeat gives.

    Raises:
        DisagreementError: there is not an update every so many steps of what is counted, or nothing is.
    """
    sides = [side.trained for side in (ours, theirs)]
    first = max(len(sides[0]) // WARM_UP, *map(_first_learned, sides))
    rates = []
    for trained in sides:
        counted = trained[first + 1 :]
        steps, updates = sum(one.steps for one in counted), sum(one.updates for one in counted)
        if not counted:
            raise DisagreementError("no episode is left after the first that learned: use more episodes")
        if not updates or abs(updates - steps / learn_every_steps) > 1:
            raise DisagreementError(
                f"there were {updates} updates in {steps} steps, one every {learn_every_steps} is due"
            )
        took = trained[-1].at_s - trained[first].at_s
        decisions, learning_s = sum(one.decisions for one in counted), sum(one.learning_s for one in counted)
        rates.append((steps / took, decisions / took, len(counted) / took, 1e3 * learning_s / updates))
    found = [Sample(f"{name}, {what}", unit, *both) for (what, unit), *both in zip(FIGURES, *rates, strict=True)]
    return [*found, Sample(f"{name}, whole run", "s", ours.wall_s, theirs.wall_s)]


def _first_learned(trained: Sequence[Trained]) -> int:
    """The first episode with an update."""
    for number, one in enumerate(trained):
        if one.updates:
            return number
    raise DisagreementError("the replay never held a batch: use more episodes")


def measure(level: str, episodes: int, repeats: int) -> Iterator[list[Sample]]:
    """A repeat after the other; before them ours runs once for what is compiled only once."""
    train_ours(level, 2)
    for repeat in range(repeats):
        print(f"{repeat} of {repeats} repeats: {ALGORITHM} {level}", file=sys.stderr, flush=True)  # noqa: T201
        ours, config, rows = train_ours(level, episodes)
        theirs = train_theirs(config, rows)
        yield samples(f"{ALGORITHM} {level}", ours, theirs, settings_of(config).dqn.learn_every_steps)


def main() -> None:
    parser = Parser(description="Compare whole training runs with a plain loop.", allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--level", default="easy", type=one_of(list(shipped())), help="default: %(default)s")
    parser.add_argument("--episodes", type=count, default=40, help="of a run; default: %(default)s")
    parser.add_argument("--repeats", type=count, default=3, help="default: %(default)s")
    chosen = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(FAILED))  # so that a run that goes on is ended, too
    torch.set_num_threads(1)
    gc.freeze()  # nobody pays for looking through all that was imported
    try:
        repeats = list(measure(chosen.level, chosen.episodes, chosen.repeats))
    except DisagreementError as error:
        print(f"railctl: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(FAILED)
    show([row_of(of_one) for of_one in zip(*repeats, strict=True)], as_json=chosen.json)


if __name__ == "__main__":
    main()
