"""python -m analysis.report --study FOLDER | --run FOLDER ...: how it answers: see `common.task`."""

import argparse
from collections import Counter
from pathlib import Path

from matplotlib import rc_context

from analysis.reliability import CurvesError
from analysis.report.contents import STAGES, contents
from analysis.report.figures.style import SETTINGS
from analysis.report.files import write
from analysis.report.loading import DamagedEvaluation, load_runs, load_study
from analysis.study import StudyFolder
from common.rows import DamagedRows
from common.strict import ConfigError
from common.task import Teller, carry_out, say


def report(options: argparse.Namespace) -> None:
    """Read, compute, draw, write, and say where."""
    study = StudyFolder(options.study) if options.study else None
    results = load_study(study) if study else load_runs(options.run)
    folder = options.output or (study or StudyFolder(Path())).report
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--output {folder}: {error.strerror}: give a folder that can be made") from None
    with rc_context(SETTINGS):
        computing, drawing = Teller("computing"), Teller("drawing")
        sections, judged = contents(results, lambda done: computing.tell(done, STAGES))
        path = write(folder, results, sections, judged, drawing.tell)
    parts = Counter(type(part).__name__ for section in sections for part in section.parts)
    states = Counter(trained.state for trained in results.runs.values())
    say({"report": str(path), "figures": parts["Figure"], "tables": parts["Table"], "runs": dict(states)})


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """What is asked for; none: on this process's own command line."""
    parser = argparse.ArgumentParser(description="Makes the report on a study, or on runs.")
    about = parser.add_mutually_exclusive_group(required=True)
    about.add_argument("--study", type=Path, help="a study's folder")
    about.add_argument("--run", type=Path, action="append", help="a run's folder; may be repeated")
    parser.add_argument("--output", type=Path, help="default: report in the study's folder, or here")
    return parser.parse_args(arguments)


def main() -> None:
    options = parsed()
    carry_out(lambda: report(options), DamagedRows, DamagedEvaluation, CurvesError)


if __name__ == "__main__":
    main()
