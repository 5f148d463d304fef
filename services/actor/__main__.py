"""python -m services.actor --run FOLDER --name NAME --serves DIFFICULTY."""

import argparse
from pathlib import Path

from common.config import DIFFICULTIES
from common.folder import RunFolder
from common.process import run_service, take_place


def main() -> None:
    parser = argparse.ArgumentParser(description="An actor of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    parser.add_argument("--name", required=True, help="this actor's name, unique in the run")
    parser.add_argument("--serves", required=True, choices=[*DIFFICULTIES, "any"], help="the difficulty it acts")
    arguments = parser.parse_args()
    with take_place(RunFolder(arguments.run), arguments.name, "actor") as place:
        # Seconds of imports come when the place is taken, so that whoever supervises sees this process at once.
        from services.actor.service import Actor

        Actor(place, arguments.serves).run()


if __name__ == "__main__":
    run_service(main)
