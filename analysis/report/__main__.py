"""python -m railctl.analysis.report --study FOLDER | --results FILE | --run FOLDER ...: how it answers: see `common.task`.

What is published has the results in a file, from which the rest of the folder can be made anew, and no PNG.
"""

import argparse
from collections import Counter
from pathlib import Path

from matplotlib import rc_context

from railctl.analysis.reliability import CurvesError
from railctl.analysis.report import archive
from railctl.analysis.report.contents import STAGES, contents
from railctl.analysis.report.figures.style import SETTINGS
from railctl.analysis.report.files import write, write_png
from railctl.analysis.report.loading import DamagedEvaluation, load_results, load_runs, load_study
from railctl.analysis.report.results import Results
from railctl.analysis.study import StudyFolder
from railctl.common.rows import DamagedRows
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say


def report(options: argparse.Namespace) -> None:
    """Read, compute, draw, write, and say where."""
    folder = options.publish or options.output or StudyFolder(options.study or Path()).report
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--output {folder}: {error.strerror}: give a folder that can be made") from None
    results = _found(options)
    with rc_context(SETTINGS):
        computing, drawing = Teller("computing"), Teller("drawing")
        sections, judged = contents(results, lambda done: computing.tell(done, STAGES))
        path = write(folder, results, sections, judged, drawing.tell)
        if not (options.results or options.publish):
            write_png(folder, sections, Teller("drawing as PNG").tell)
    parts = Counter(type(part).__name__ for section in sections for part in section.parts)
    states = Counter(trained.state for trained in results.runs.values())
    say({"report": str(path), "figures": parts["Figure"], "tables": parts["Table"], "runs": dict(states)})


def _found(options: argparse.Namespace) -> Results:
    if options.publish:
        published = StudyFolder(options.publish).results
        archive.save(published, load_study(StudyFolder(options.study)))
        return load_results(published)
    if options.study:
        return load_study(StudyFolder(options.study))
    return load_results(options.results) if options.results else load_runs(options.run)


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """What is asked for; none: on this process's own command line."""
    parser = argparse.ArgumentParser(description="Makes the report on a study, or on runs.")
    about = parser.add_mutually_exclusive_group(required=True)
    about.add_argument("--study", type=Path, help="a study's folder")
    about.add_argument("--results", type=Path, help="a file of railctl study publish")
    about.add_argument("--run", type=Path, action="append", help="a run's folder; may be repeated")
    parser.add_argument("--publish", type=Path, help="keep a study's results in this folder, with the report on them")
    parser.add_argument("--output", type=Path, help="default: report in the study's folder, or here")
    return parser.parse_args(arguments)


def main() -> None:
    options = parsed()
    carry_out(lambda: report(options), DamagedRows, DamagedEvaluation, CurvesError)


if __name__ == "__main__":
    main()
