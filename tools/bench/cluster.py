"""What whole clusters do: `railctl bench cluster`.

Every row is a run as a user starts it, `railctl up`, from nothing to its end with its evaluations: at lag 0 acted by
its learner and by one actor, and at a lag and free with two actors; or with all lags by all numbers of actors that are
given. With machines, so many network namespaces of this machine have the actors, which join over TLS, and the run
begins when all are there. Beside it stands the same run in one process without a message (`tools.bench.alone`), which
must come to the same episodes, unless the lag is free: then its weights are never stale. Levels are generated as they
come, without a bank.

It prints one document `{"rows": [...]}` with the fields of `Row`. Rates and shares leave out the first tenth of the
episodes. The learner's time is learning, publishing, or waiting for actors and messages.
"""

import argparse
import json
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

from rich.table import Table

from railctl.common.config import MAX_ACTORS, checked_lag
from railctl.common.folder import RunFolder
from railctl.common.levels.distributions import shipped
from railctl.common.records.rows import EpisodeRow, MetricRow
from railctl.common.rows import read_rows
from railctl.common.task import FAILED
from railctl.deploy.output import print_table
from railctl.tools.bench.alone import Alone
from railctl.tools.bench.launching import NAME, Case, play
from railctl.tools.bench.machines import MOST_MACHINES, NoMachinesError
from railctl.tools.bench.measuring import DisagreementError, Parser, count, one_of
from railctl.tools.bench.processes import Watch

ALGORITHMS = ("dqn", "ddqn", "dddqn", "drqn", "ppo", "ppor", "sil")  # the study's
OTHERS = ("imitate", "dispatch")
FREE = "free"
KINDS = (("0", 0), ("0", 1), ("3", 2), (FREE, 2))  # lag and actors
SOME_LAGS, SOME_ACTORS = ("0", "3", FREE), (2,)  # if only the other is given
SPENT = (
    *("learning_s", "publishing_s", "learner_waited_s", "acting_s", "fragments"),
    *("messages", "message_bytes"),
    "staleness",
)
WARM_UP = 10  # one in so many episodes
COLUMNS = (  # of the table: title, field, and how it is written
    ("start s", "start_s", ".1f"),
    ("end s", "end_s", ".1f"),
    ("wall s", "wall_s", ".1f"),
    ("episodes/s", "episodes_per_s", ".1f"),
    ("steps/s", "steps_per_s", ".0f"),
    ("alone", "alone_steps_per_s", ".0f"),
    ("decisions/s", "decisions_per_s", ".0f"),
    ("learning", "learning", ".0%"),
    ("publishing", "publishing", ".0%"),
    ("waiting", "waiting", ".0%"),
    ("staleness", "staleness", ".1f"),
    ("acting ms", "acting_ms", ".2f"),
    ("beyond ms", "beyond_ms", ".2f"),
    ("messages", "messages", ".1f"),
    ("kB", "kilobytes", ".1f"),
    ("CPU ms/episode", "cpu_ms", ".0f"),
    ("MiB", "memory_mib", ".0f"),
)


@dataclass(frozen=True)
class Row:
    """A run.

    Attributes:
        name: algorithm, level, lag, actors and machines.
        start_s: from the command, with the joining of machines, to the first trained episode.
        end_s: from the last trained episode to the end of the command.
        wall_s: of the command.
        episodes_per_s, steps_per_s, decisions_per_s: trained.
        alone_steps_per_s: those of one process without messages, which trains the same.
        learning, publishing, waiting: shares of the learner's time.
        staleness: how many versions of the weights came while an episode was acted, the mean.
        acting_ms: that actors act a fragment; under a lag while the learner learns.
        beyond_ms: a fragment's wall time beyond learning: at lag 0 acting, messages, and waiting for the processor.
        messages, kilobytes: a fragment, to and from the learner, heartbeats and rows among them, weights not.
        cpu_ms: processor time of all processes, an episode.
        memory_mib: of all processes, the peak of the sum; what they share counts once.
    """

    name: str
    start_s: float
    end_s: float
    wall_s: float
    episodes_per_s: float
    steps_per_s: float
    decisions_per_s: float
    alone_steps_per_s: float
    learning: float
    publishing: float
    waiting: float
    staleness: float
    acting_ms: float
    beyond_ms: float
    messages: float
    kilobytes: float
    cpu_ms: float
    memory_mib: float


def run_cluster(case: Case, episodes: int) -> Row:
    """Run a cluster, and the same run alone.

    Raises:
        DisagreementError: they trained different episodes, or the cluster failed.
        NoMachinesError: the system lets nobody make any.
    """
    with tempfile.TemporaryDirectory(prefix="railctl-bench-") as folder:
        began = time.time()
        with Watch(folder) as watch:
            play(case, episodes, folder)
        wall_s = time.time() - began
        run = RunFolder(Path(folder) / NAME)
        rows, metrics = read_rows(run.episodes_file, EpisodeRow), read_rows(run.metrics_file, MetricRow)
        alone = Alone(run.config()).run()
    if case.lag != FREE and [row.digest for row in rows] != [trained.digest for trained in alone]:
        raise DisagreementError(f"{case.name} trained other episodes in one process")
    warm = episodes // WARM_UP
    took = rows[-1].trained_unix_s - rows[warm].trained_unix_s
    took_alone = alone[-1].at_s - alone[warm].at_s
    counted = rows[warm + 1 :]
    spent = {name: sum(row.metrics[name] for row in metrics[warm + 1 :]) for name in SPENT}
    steps = sum(row.steps for row in counted)
    figures = {
        "start_s": rows[0].trained_unix_s - began,
        "end_s": began + wall_s - rows[-1].trained_unix_s,
        "wall_s": wall_s,
        "episodes_per_s": len(counted) / took,
        "steps_per_s": steps / took,
        "decisions_per_s": sum(row.decisions for row in counted) / took,
        "alone_steps_per_s": steps / took_alone,
        "learning": spent["learning_s"] / took,
        "publishing": spent["publishing_s"] / took,
        "waiting": spent["learner_waited_s"] / took,
        "staleness": spent["staleness"] / len(counted),
        "acting_ms": 1e3 * spent["acting_s"] / spent["fragments"],
        "beyond_ms": 1e3 * (took - spent["learning_s"]) / spent["fragments"],
        "messages": spent["messages"] / spent["fragments"],
        "kilobytes": 1e-3 * spent["message_bytes"] / spent["fragments"],
        "cpu_ms": 1e3 * watch.cpu_s / episodes,
        "memory_mib": watch.peak_bytes / 2**20,
    }
    return Row(case.name, **{name: float(f"{value:.4g}") for name, value in figures.items()})


def cases_of(
    algorithms: Sequence[str],
    level: str,
    lags: Sequence[str] | None,
    actors: Sequence[int] | None,
    machines: Sequence[int] | None,
) -> list[Case]:
    """The runs: of each algorithm all that are given with each other, or those that are measured if none are."""
    if not (lags or actors or machines):
        return [Case(algorithm, level, lag, count) for algorithm in algorithms for lag, count in KINDS]
    every = product(algorithms, [level], lags or SOME_LAGS, actors or SOME_ACTORS, machines or (0,))
    return [Case(*of) for of in every]


def lag_of(text: str) -> str:
    """The value of an option that is a lag."""
    try:
        checked_lag(int(text) if text.isdecimal() else text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def up_to(most: int) -> Callable[[str], int]:
    """What reads an option that counts actors or machines."""

    def number_of(text: str) -> int:
        if not text.isdecimal() or int(text) > most:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to {most}")
        return int(text)

    return number_of


def show(rows: Sequence[Row]) -> None:
    """Print the rows for a person."""
    table = Table(box=None, pad_edge=False)
    table.add_column("", no_wrap=True)
    for title, _, _ in COLUMNS:
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.name, *(format(getattr(row, field), form) for _, field, form in COLUMNS))
    print_table(table)


def main() -> None:
    parser = Parser(description="Measure whole clusters.", allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--episodes", type=count, default=300, help="of a run; default: %(default)s")
    parser.add_argument("--level", default="easy", type=one_of(list(shipped())), help="default: %(default)s")
    parser.add_argument("--algorithm", action="append", type=one_of(ALGORITHMS + OTHERS), help="default: the study's")
    parser.add_argument("--lag", action="append", type=lag_of, help="a number or free; may be repeated")
    parser.add_argument("--actors", action="append", type=up_to(MAX_ACTORS), help="by each lag; may be repeated")
    parser.add_argument("--machines", action="append", type=up_to(MOST_MACHINES), help="that have the actors; likewise")
    chosen = parser.parse_args()
    if chosen.episodes < 2:
        parser.error(f"--episodes {chosen.episodes}: a rate needs at least 2")
    cases = cases_of(chosen.algorithm or ALGORITHMS, chosen.level, chosen.lag, chosen.actors, chosen.machines)
    for case in cases:
        if case.actors < case.machines:
            parser.error(f"--actors {case.actors}: {case.machines} machines need an actor each: use more")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(FAILED))
    rows: list[Row] = []
    try:
        for number, case in enumerate(cases):
            print(f"{number} of {len(cases)} runs: {case.name}", file=sys.stderr, flush=True)  # noqa: T201
            rows.append(run_cluster(case, chosen.episodes))
    except (DisagreementError, NoMachinesError) as error:
        print(f"railctl: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(FAILED)
    finally:  # what has been measured is not lost if something goes wrong, or somebody has seen enough
        if chosen.json:
            print(json.dumps({"rows": [asdict(row) for row in rows]}, indent=2))  # noqa: T201
        elif rows:
            with suppress(BrokenPipeError):  # the reader has gone
                show(rows)


if __name__ == "__main__":
    main()
