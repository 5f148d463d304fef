"""railctl study publish: what came out of a study, in a folder that is small enough to be handed on."""

from pathlib import Path
from typing import Annotated

import typer

from railctl.deploy.commands.study.options import StudyName
from railctl.deploy.output import AsJson, one_line_errors, say
from railctl.deploy.study.described import find_folder
from railctl.deploy.study.runner import REPORTER
from railctl.deploy.task import run_task


@one_line_errors
def publish(
    name: StudyName,
    output: Annotated[Path, typer.Option(help="Folder to write to; what is there of an earlier time is replaced.")],
    as_json: AsJson = False,
) -> None:
    """Keep a study's results and the report on them in a small folder, which needs no runs."""
    result = run_task(REPORTER, "--study", str(find_folder(name).path), "--publish", str(output))
    done, runs = result["runs"].get("done", 0), sum(result["runs"].values())
    told = "" if done == runs else f" (of {done} of {runs} runs; the others are not done)"
    say(f"results  {output / 'results.json.xz'}{told}\nreport   {result['report']}", result, as_json=as_json)
