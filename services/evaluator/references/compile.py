"""python -m railctl.services.evaluator.references.compile: compiles the reference policies, so that no evaluation has to.

The machine code is kept beside the sources, or in the user's cache where those cannot be written.
"""

from railctl.common.requests import LevelChoice, Reference, ReferenceRequest
from railctl.common.task import carry_out
from railctl.services.evaluator.references.__main__ import score

POLICIES: tuple[Reference, ...] = (
    "shortest-path",
    "shortest-path-safe",
    "deadlock-avoidance",
    "planner",
    "planner-replanned",
)


def main() -> None:
    """Play an episode with each."""
    for policy in POLICIES:
        score(ReferenceRequest(policy=policy, levels=LevelChoice(names=("easy",), episodes=1)))


if __name__ == "__main__":
    carry_out(main)
