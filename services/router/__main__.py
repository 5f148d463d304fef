"""The router: every other process is its client. It listens where the run's cluster file says."""

import argparse
from pathlib import Path

from common.bus import open_router
from common.folder import RunFolder
from common.process import run_service, take_place

LOOK_S = 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    folder = RunFolder(parser.parse_args().run)
    endpoint, _ = folder.endpoint_and_namespace()
    with open_router(endpoint), take_place(folder, "router", "router") as place:
        while not place.stopping.asked:
            place.heart.beat("routing")
            place.stopping.wait(LOOK_S)


if __name__ == "__main__":
    run_service(main)
