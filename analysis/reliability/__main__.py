"""python -m railctl.analysis.reliability FILE: judges the curves of a file; how it answers: see `common.task`."""

import argparse
from pathlib import Path

from railctl.analysis.reliability import RECORDS, CurvesError, judge, parse_switches, sensitivity
from railctl.analysis.reliability.files import load
from railctl.common.task import Teller, carry_out, say


def reliability(options: argparse.Namespace) -> None:
    """Say all that the options ask for."""
    switches = parse_switches(dict(setting.partition("=")[::2] for setting in options.switch or []))
    curves = load(options.file)
    tell = Teller("metrics").tell
    document = judge(curves, protocol=options.random_protocol, keys=options.key, switches=switches, tell=tell)
    say(document | {"sensitivity": sensitivity(curves)})


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """What is asked for; none: on this process's own command line."""
    parser = argparse.ArgumentParser(description="Judges learning curves.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--random-protocol", choices=("default", "tool"), default="default")
    parser.add_argument("--key", action="append", choices=list(RECORDS), help="a record; may be repeated; default: all")
    parser.add_argument("--switch", action="append", metavar="NAME=VALUE", help="may be repeated")
    return parser.parse_args(arguments)


def main() -> None:
    options = parsed()
    carry_out(lambda: reliability(options), CurvesError)


if __name__ == "__main__":
    main()
