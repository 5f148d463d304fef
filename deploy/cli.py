"""The railctl command line: one verb a file in `deploy.commands`, imported when it is given."""

import platform
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from railctl.deploy.verbs import Verb, group

app = group(
    "Train train dispatchers: an exact, distributed actor-learner system for Flatland.",
    {
        "up": Verb(
            "railctl.deploy.commands.up:up",
            "Start a run or go on with one: router, learner, actors, evaluator and their supervisor.",
        ),
        "list": Verb(
            "railctl.deploy.commands.list:list_",
            "List all runs, the newest last: state, algorithm, levels, progress, return of the last 100 episodes.",
        ),
        "status": Verb(
            "railctl.deploy.commands.status:status",
            "Show a run's progress, its processes (role, level, pid, state, restarts, last heartbeat) and last events.",
        ),
        "tail": Verb(
            "railctl.deploy.commands.tail:tail",
            "Follow a run's episodes and evaluations, with full history, until it ends.",
        ),
        "watch": Verb(
            "railctl.deploy.commands.watch:watch",
            "Show runs and studies live in the browser: curves, actors to scale, and trains as they are driven.",
        ),
        "mirror": Verb(
            "railctl.deploy.commands.mirror:mirror",
            "Bring a run's configuration and rows to MLflow, with full history, and follow it until it ends.",
        ),
        "logs": Verb(
            "railctl.deploy.commands.logs:logs",
            "Print the last lines of the logs of a run's processes, the supervisor's included.",
        ),
        "scale": Verb(
            "railctl.deploy.commands.scale:scale",
            "Change how many actors serve each level; those not named stay as they are.",
        ),
        "pause": Verb(
            "railctl.deploy.commands.pause:pause",
            "Hold a run: what is being acted is finished, nothing new begins. It stays paused until railctl resume.",
        ),
        "resume": Verb("railctl.deploy.commands.resume:resume", "Go on with a paused run."),
        "checkpoint": Verb(
            "railctl.deploy.commands.checkpoint:checkpoint",
            "Write a checkpoint and a snapshot now; the checkpoint is evaluated like any other.",
        ),
        "join": Verb(
            "railctl.deploy.commands.join:join_run",
            "Act for a run on another machine, until it is trained or Ctrl-C; no folder of the run is needed here.",
        ),
        "relay": Verb(
            "railctl.deploy.commands.relay:relay",
            "Link machines that join here to a run's host, by one link, until Ctrl-C.",
        ),
        "place": Verb(
            "railctl.deploy.commands.place:place",
            "Print what has Slurm or Kubernetes start a run on several nodes; it starts nothing itself.",
        ),
        "down": Verb(
            "railctl.deploy.commands.down:down",
            "Stop every process of a run; the learner writes a snapshot first, so that nothing is lost.",
        ),
        "evaluate": Verb(
            "railctl.deploy.commands.evaluate:evaluate",
            "Play levels with a checkpoint or a reference policy, and print what becomes of them.",
        ),
        "render": Verb(
            "railctl.deploy.commands.render:render",
            "Draw an episode on its map, as a film or a picture; two policies beside each other with --against.",
        ),
        "demonstrate": Verb(
            "railctl.deploy.commands.demonstrate:demonstrate",
            "Write episodes that a policy plays on the training levels of a run, for others to learn.",
        ),
        "export": Verb(
            "railctl.deploy.commands.export:export",
            "Write a checkpoint for other programs: its network as ONNX, or a folder for flatland-rl's evaluator.",
        ),
        "report": Verb(
            "railctl.deploy.commands.report:report",
            "Compare runs on a page that needs nothing else, or rank algorithms by how reliably they learn.",
        ),
        "doctor": Verb(
            "railctl.deploy.commands.doctor:doctor",
            "Check this machine: system, packages, compiled code, cores, memory, disk, clock, Zenoh, arithmetic.",
        ),
        "bench": Verb(
            "railctl.deploy.commands.bench:bench",
            "Measure ours beside others: same work, one process, one core; a ratio above 1 says that ours is better.",
        ),
        "keys": Verb(
            "railctl.deploy.commands.keys:app", "Make the keys by which the machines of a run know each other."
        ),
        "levels": Verb("railctl.deploy.commands.levels:app", "List, build, show, verify, import and export levels."),
        "study": Verb(
            "railctl.deploy.commands.study:app", "Plan, run, watch and report on studies: many runs that are compared."
        ),
    },
    completes=True,
)


def _say_version(asked: bool) -> None:
    if asked:
        print(f"railctl {version('railctl')}")
        raise typer.Exit


@app.callback()
def whole(
    _version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Stand for what all verbs have in common."""


def main() -> None:
    """Run the command line; on Linux alone, for what ends processes and keeps sockets private is Linux's."""
    if platform.system() != "Linux":
        remedy = "use Linux, a virtual machine, or the image that the Dockerfile makes"
        print(f"railctl: {platform.system()} is not supported: {remedy}", file=sys.stderr)
        sys.exit(2)  # wrong usage; nothing is imported yet that has a name for it
    app()
