"""python -m railctl.services.learner --run FOLDER."""

import argparse
from contextlib import closing
from pathlib import Path

from railctl.common.folder import RunFolder
from railctl.common.inbox import Inbox
from railctl.common.process import run_service, service_context


def main() -> None:
    parser = argparse.ArgumentParser(description="The learner of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    inbox = Inbox()
    with service_context(RunFolder(parser.parse_args().run), "learner", "learner", inbox) as context:
        # Imports take seconds and come last, so that whoever supervises sees this process at once.
        from railctl.services.learner.service import Learner

        with closing(Learner(context, inbox)) as learner:
            learner.run()


if __name__ == "__main__":
    run_service(main)
