"""python -m railctl.services.actor --run FOLDER --name NAME --serves DIFFICULTY."""

import argparse
from pathlib import Path

from railctl.common.folder import RunFolder
from railctl.common.process import run_service, service_context


def main() -> None:
    parser = argparse.ArgumentParser(description="An actor of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    parser.add_argument("--name", required=True, help="this actor's name, unique in the run")
    parser.add_argument("--serves", required=True, help="the level it acts, or any")
    arguments = parser.parse_args()
    with service_context(RunFolder(arguments.run), arguments.name, "actor") as context:
        # Imports take seconds and come last, so that whoever supervises sees this process at once.
        from railctl.services.actor.service import Actor

        Actor(context, arguments.serves).run()


if __name__ == "__main__":
    run_service(main)
