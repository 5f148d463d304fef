"""Stands for `railctl` where the documents are executed: what it is told is carried out, with less to do.

Runs are of a few episodes, and the run `live` goes on until somebody ends it, in the background; benchmarks are not
repeated, and studies are as small as can be. All else is as it is written.
"""

import os
import sys
from pathlib import Path

from railctl.tools.bench.machines import Machine, NoMachinesError

REAL = Path(sys.executable).with_name("railctl")
FEW = ["--episodes", "20", "--set", "evaluation.every_episodes=10", "--set", "evaluation.levels=2"]
LIVE = ["--episodes", "1000000", "--set", "evaluation.every_episodes=20", "--set", "evaluation.levels=2", "--detach"]
SMALL_STUDY = """
name: {name}
contenders: [dddqn, ppo]
levels: [easy]
seeds: [1]
episodes: 20
settings: {{evaluation: {{every_episodes: 10, levels: 2}}}}
evaluation: {{episodes: 2, seed: 0}}
references: [random]
judgement: {{block: 5, zones: 3, bootstraps: 10, permutations: 10}}
"""


def shortened(arguments: list[str]) -> list[str]:
    """The arguments, with less to do."""
    less = arguments
    match arguments:
        case ["up", *_] if "--detach" in arguments or "live" in arguments or "--listen" in arguments:
            less = without(arguments, "--episodes") + LIVE
        case ["up", "--name", _]:  # goes on with a run as it is
            pass
        case ["up", *_]:
            less = without(arguments, "--episodes") + FEW
        case ["bench", "cluster", *_]:
            less = [*without(arguments, "--episodes"), "--episodes", "4"]
            while "--machines" in less and not makes_machines():
                less = without(less, "--machines")
        case ["bench", "loop", *_]:
            less = [*without(arguments, "--episodes"), "--episodes", "20", "--repeats", "1"]
        case ["bench", *_]:
            less = [*arguments, "--repeats", "1"]
        case ["evaluate", *_] if "--levels" not in arguments:
            less = [*without(arguments, "--episodes"), "--episodes", "2"]
        case ["study", verb, name, *rest] if verb != "place":
            less = ["study", verb, small_study(name), *rest]
    return less


def makes_machines() -> bool:
    """Whether network namespaces can be made here."""
    try:
        with Machine(255):
            return True
    except NoMachinesError:
        return False


def without(arguments: list[str], option: str) -> list[str]:
    """The arguments without an option and its value."""
    if option not in arguments:
        return arguments
    place = arguments.index(option)
    return arguments[:place] + arguments[place + 2 :]


def small_study(name: str) -> str:
    """A small one of the same name, as a file."""
    path = Path(f"{name}.yaml")
    path.write_text(SMALL_STUDY.format(name=name))
    return str(path)


if __name__ == "__main__":
    os.execv(REAL, [str(REAL), *shortened(sys.argv[1:])])  # noqa: S606  (it is the command that is executed)
