"""python -m railctl.services.evaluator.references.compile: compiles reference policies, so that no evaluation has to.

The machine code is kept beside the sources, or in the user's cache where those cannot be written.
"""

import tempfile
from pathlib import Path

from railctl.common.requests import LevelChoice, PlaybackRequest, Reference, ReferenceRequest
from railctl.common.task import carry_out
from railctl.services.evaluator.playback import play_back
from railctl.services.evaluator.references.__main__ import score

POLICIES: tuple[Reference, ...] = (
    "shortest-path",
    "shortest-path-safe",
    "deadlock-avoidance",
    "planner",
    "planner-replanned",
)


def main() -> None:
    """Play an episode with each, and write one down."""
    levels = LevelChoice(names=("easy",), episodes=1)
    for policy in POLICIES:
        score(ReferenceRequest(policy=policy, levels=levels))
    with tempfile.TemporaryDirectory(prefix="railctl-") as folder:
        play_back(PlaybackRequest(policy=POLICIES[0], levels=levels, file=Path(folder) / "episode.json"))


if __name__ == "__main__":
    carry_out(main)
