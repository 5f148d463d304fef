"""python evaluate.py LEVEL.pkl ...: flatland-rl's own commands play levels with the checkpoint beside this file.

A line a level, as `flatland-trajectory-evaluate` finds it when it plays the trajectory again, then the means.
"""

import contextlib
import csv
import io
import sys
import tempfile
from importlib.metadata import entry_points
from pathlib import Path

HERE = Path(__file__).resolve().parent
REWARDS = ["--rewards", "railctl_policy.Rewards"]
CLASSES = ["--policy", "railctl_policy.Policy", "--obs-builder", "railctl_policy.Observation", *REWARDS]
ARRIVED = "event_logs/TrainMovementEvents.trains_arrived.tsv"


def command(name: str, *arguments: str) -> None:
    """Run a console command of flatland-rl in this process; its progress bars are left out."""
    [found] = entry_points(group="console_scripts", name=name)
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            found.load().main(list(arguments), standalone_mode=False)
    except Exception as error:
        lines = said.getvalue().splitlines()
        raise SystemExit(f"{name}: {error or lines[-1:]}") from error


def play(level: Path) -> tuple[float, float]:
    """Play a level, and have it evaluated: the normalised return, and the share of the trains that arrived."""
    with tempfile.TemporaryDirectory() as data:
        where = ["--data-dir", data, "--ep-id", "episode"]
        told = ["--env-path", str(level), "--snapshot-interval", "0"]
        command("flatland-trajectory-generate-from-policy", *where, *CLASSES, *told)
        command("flatland-trajectory-evaluate", *where, *REWARDS)
        with (Path(data) / ARRIVED).open() as file:
            [row] = csv.DictReader(file, delimiter="\t")
    return float(row["normalized_reward"]), float(row["success_rate"])


def main() -> None:
    levels = [Path(name) for name in sys.argv[1:]]
    if not levels or not all(level.is_file() for level in levels):
        sys.exit("usage: python evaluate.py LEVEL.pkl ...  (railctl levels export --output FOLDER writes some)")
    sys.path.insert(0, str(HERE))
    played = []
    for level in levels:
        played.append(play(level))
        print(f"{level.name:32}  return {played[-1][0]:8.5f}  arrived {played[-1][1]:4.0%}", flush=True)  # noqa: T201
    returns, shares = zip(*played, strict=True)
    count = len(played)
    print(f"mean of {count:<25}  return {sum(returns) / count:8.5f}  arrived {sum(shares) / count:4.0%}")  # noqa: T201


if __name__ == "__main__":
    main()
