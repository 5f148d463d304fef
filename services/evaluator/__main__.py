"""python -m railctl.services.evaluator --run FOLDER."""

import argparse
from pathlib import Path

from railctl.common.folder import RunFolder
from railctl.common.process import run_service, service_context


def main() -> None:
    parser = argparse.ArgumentParser(description="The evaluator of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    with service_context(RunFolder(parser.parse_args().run), "evaluator", "evaluator") as context:
        # Imports take seconds and come last, so that whoever supervises sees this process at once.
        from railctl.services.evaluator.service import Evaluator

        Evaluator(context).run()


if __name__ == "__main__":
    run_service(main)
