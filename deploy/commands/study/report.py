"""railctl study report: the report on whatever is there of a study."""

from railctl.deploy.commands.study.options import StudyName
from railctl.deploy.output import AsJson, one_line_errors, say
from railctl.deploy.study.described import find_folder
from railctl.deploy.study.runner import REPORTER
from railctl.deploy.task import run_task


@one_line_errors
def report(name: StudyName, as_json: AsJson = False) -> None:
    """Make a study's report anew, of whatever has been done of it."""
    result = run_task(REPORTER, "--study", str(find_folder(name).path))
    say(f"report   {result['report']}", result, as_json=as_json)
