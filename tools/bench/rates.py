"""python -m railctl.tools.bench.rates FILE: what runs take in one process without messages, for `railctl study plan`.

FILE holds {"bank": folder of generated levels, "runs": {name: configuration}} in JSON. Of each run episodes are
trained for two seconds, then a few levels are scored. The result has for each name `episode_s`, how many `episodes`
that comes from, `fragments` an episode, `level_s`, and `checkpoint_bytes`. Episodes get shorter as trains learn to
arrive: the rest of a run is taken to go on as the last third of what was trained.
"""

import sys
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from railctl.common.bounded import read_json
from railctl.common.config import RunConfig, parse_config
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.flat import Arrays
from railctl.common.policy.player import Acting, Players, chooser_of, play
from railctl.common.task import Teller, carry_out, say
from railctl.tools.bench.alone import Alone

WARM_UP = 2  # episodes that do not count
COUNTED_S = 2.0  # of training, at least
COUNTED = 3  # episodes, at least
LEVELS = 5  # scored, the first of which does not count


def rates(config: RunConfig, bank: Path) -> dict[str, float]:
    """What a run takes."""
    supply = LevelSupply(config.world.levels, bank, base=Path())
    alone = Alone(config, supply)
    episodes = alone.train()
    for _ in islice(episodes, min(WARM_UP, config.episodes - 1)):
        pass
    begun = time.perf_counter()
    ends_s, versions = [0.0], [alone.version]
    for _ in episodes:
        ends_s.append(time.perf_counter() - begun)
        versions.append(alone.version)
        if ends_s[-1] >= COUNTED_S and len(ends_s) > COUNTED:
            break
    weights = alone.weights()
    return {
        "episode_s": whole_mean(ends_s, config.episodes),
        "episodes": len(ends_s) - 1,
        "fragments": whole_mean(versions, config.episodes),
        "level_s": level_seconds(config, supply, weights),
        "checkpoint_bytes": sum(array.nbytes for array in weights.values()),
    }


def whole_mean(sums: Sequence[float], episodes: int) -> float:
    """The mean of what so many episodes take, from sums before and after each of the first ones.

    >>> whole_mean([0, 4, 7, 8], 10)  # 4, 3, 1, and seven times 1
    1.5
    """
    counted = len(sums) - 1
    last = -(-counted // 3)
    rate = (sums[-1] - sums[-1 - last]) / last
    return (sums[-1] - sums[0] + max(0, episodes - counted) * rate) / max(episodes, counted)


def level_seconds(config: RunConfig, supply: LevelSupply, weights: Arrays) -> float:
    """What scoring a network on a level takes, as the first of a run's mix."""
    network = chooser_of(config)
    network.load(weights)
    name = next(iter(config.mix))
    player = Players(config, network).of(name)
    greedy = config.evaluation.mode == "greedy"
    levels = min(LEVELS, config.evaluation.levels)
    begun = time.perf_counter()
    for index in range(levels):
        if index == 1:
            begun = time.perf_counter()
        play(player, supply.evaluation(name, index), Acting(network, greedy=greedy))
    return (time.perf_counter() - begun) / max(1, levels - 1)


def main() -> None:
    asked = read_json(Path(sys.argv[1]))
    teller, found = Teller("measured"), {}
    for number, (name, data) in enumerate(asked["runs"].items(), start=1):
        found[name] = rates(parse_config(data), Path(asked["bank"]))
        teller.tell(number, len(asked["runs"]))
    say(found)


if __name__ == "__main__":
    carry_out(main, ValueError)
