"""python -m services.evaluator --run FOLDER."""

import argparse
from pathlib import Path

from common.folder import RunFolder
from common.policy.determinism import deterministic_torch
from common.process import run_service, take_place
from services.evaluator.service import Evaluator


def main() -> None:
    parser = argparse.ArgumentParser(description="The evaluator of a run.")
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    deterministic_torch()
    with take_place(RunFolder(parser.parse_args().run), "evaluator", "evaluator") as place:
        Evaluator(place).run()


if __name__ == "__main__":
    run_service(main)
