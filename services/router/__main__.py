"""The router: every other process is its client. Where it listens, the run's cluster file and configuration say."""

import argparse
from pathlib import Path

from railctl.common.bus import open_router
from railctl.common.folder import RunFolder
from railctl.common.locks import sole
from railctl.common.process import Stopping, join, run_service

LOOK_S = 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, required=True, help="the run's folder")
    folder = RunFolder(parser.parse_args().run)
    endpoint, _ = folder.endpoint_and_namespace()
    stopping = Stopping()
    # The name comes before the port: a second router gives way to the first instead of failing.
    with (
        sole(folder, "router"),
        open_router(endpoint, folder.door()),
        join(folder, "router", "router", stopping) as context,
    ):
        while not context.stopping.asked:
            context.heartbeat.beat("routing")
            context.stopping.wait(LOOK_S)


if __name__ == "__main__":
    run_service(main)
