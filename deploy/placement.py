"""Where runs go on the machines of a site: one over a host and nodes that join it, or those of a study. Pure.

`deploy.backends` renders a placement for what a site starts things with; nothing here starts anything.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from railctl.analysis.study import Study
from railctl.common.config import MAX_ACTORS, MAX_LAG, Plain, RunConfig
from railctl.common.levels.distributions import ANY
from railctl.common.plain_yaml import dump_yaml
from railctl.common.strict import ConfigError, nearest, shortened
from railctl.deploy.launch import check_name
from railctl.deploy.resolve import resolve
from railctl.deploy.study.described import configurations
from railctl.deploy.study.shares import check_shares
from railctl.deploy.whole_paths import with_whole_paths

PORTS = range(1024, 65536)  # those below are for root alone
MAX_NODES = MAX_LAG + 1  # no lag has work for an actor on each of more
HOST_MIB = 4096  # router, learner, evaluator, supervisor, and what they hold for a moment
JOIN_MIB = 1024
ACTOR_MIB = 512
RUN_MIB = 2048  # of a study: supervisor, router, learner, evaluator
WAIT_S = 3600  # of who joins: its node may be there long before the host's


class Size(NamedTuple):
    """What a machine has to offer."""

    cores: int
    memory_mib: int


@dataclass(frozen=True)
class Placement:
    """A run over several nodes.

    Attributes:
        name: of the run.
        given: what a run file says of it.
        port: on which its host is joined.
        joining: how many nodes join.
        actors: on each of those, by what they serve.
        host: what the run's host needs.
    """

    name: str
    given: Plain
    port: int
    joining: int
    actors: Mapping[str, int]
    host: Size

    @property
    def run_file(self) -> str:
        """The run file that the host starts from; whatever becomes of the user's, this is what has been checked."""
        return dump_yaml(self.given)

    @property
    def joiner(self) -> Size:
        """What a node needs that joins."""
        return joiner_size(self.actors)

    def up(self, run_file: str, keys: str) -> list[str]:
        """The command of the host, the first time and every time it goes on."""
        listen = f"tls/0.0.0.0:{self.port}"
        return ["railctl", "up", "--file", run_file, "--name", self.name, "--listen", listen, "--keys", keys]

    def join(self, host: str, keys: str, actors: Mapping[str, int]) -> list[str]:
        """The command of a node that joins."""
        counts = ",".join(f"{level}={count}" for level, count in actors.items())
        address = f"tls/{host}:{self.port}"
        return ["railctl", "join", address, "--keys", keys, "--actors", counts, "--wait", str(WAIT_S)]


def joiner_size(actors: Mapping[str, int]) -> Size:
    """What these actors need: a core each."""
    count = sum(actors.values())
    return Size(count, JOIN_MIB + ACTOR_MIB * count)


def placed(  # noqa: PLR0913  (all that a user says)
    given: Plain, base: Path, name: str, nodes: int, actors: Mapping[str, int], port: int
) -> Placement:
    """The placement of a run that has been checked.

    Args:
        given: what the user says of the run.
        base: where paths in it begin.
        name: of the run.
        nodes: how many there are, the host included.
        actors: on every other one.
        port: on which the host is joined.

    Raises:
        ConfigError: the run's configuration is wrong, or something of the placement.
    """
    check_name(name)
    config = resolve(given, base)
    _check(config, nodes, actors, port)
    own = sum(config.cluster.actors.values())
    return Placement(
        name=name,
        given=with_whole_paths(given, base.resolve()),
        port=port,
        joining=nodes - 1,
        actors={level: count for level, count in actors.items() if count},
        host=Size(config.cluster.cores, HOST_MIB + ACTOR_MIB * own),
    )


def _check(config: RunConfig, nodes: int, actors: Mapping[str, int], port: int) -> None:
    if not 2 <= nodes <= MAX_NODES:
        raise ConfigError(f"--nodes {shortened(nodes)}: the run's host is one of them, give 2 to {MAX_NODES}")
    for level in actors:
        if level != ANY and level not in config.mix:
            raise ConfigError(f"--actors-per-node {level}: the run has no such level{nearest(level, list(config.mix))}")
    if not 1 <= sum(actors.values()) <= MAX_ACTORS:
        raise ConfigError(f"--actors-per-node: {sum(actors.values())} in all, give 1 to {MAX_ACTORS}")
    if port not in PORTS:
        raise ConfigError(f"--port {port}: give one from {PORTS[0]} to {PORTS[-1]}")


@dataclass(frozen=True)
class StudyPlacement:
    """A study whose runs are shared out among jobs.

    Attributes:
        study: what names it for `railctl study run`.
        name: of its folder.
        shares: how many jobs there are.
        cores: of each, a run on every one.
    """

    study: str
    name: str
    shares: int
    cores: int

    @property
    def size(self) -> Size:
        """What each job needs."""
        return Size(self.cores, RUN_MIB * self.cores)

    def run(self, number: str) -> list[str]:
        """The command of a job, the first time and every time it goes on."""
        share = ["--share", f"{number}/{self.shares}", "--cores", str(self.cores)]
        return ["railctl", "study", "run", self.study, "--name", self.name, *share]


def placed_study(study: Study, named: str, shares: int, cores: int) -> StudyPlacement:
    """The placement of a study that has been checked, also the configurations of its runs.

    Args:
        study: under the name of its folder.
        named: what the user calls it: a name, or the path of its file.
        shares: how many jobs do its runs between them.
        cores: of each job.

    Raises:
        ConfigError: the study is wrong, or cannot be shared so.
    """
    configurations(study, cores)
    check_shares(f"--shares {shares}", shares, study)
    path = Path(named)
    word = str(path.resolve()) if path.suffix in {".yaml", ".yml"} else named
    return StudyPlacement(word, study.name, shares, cores)
