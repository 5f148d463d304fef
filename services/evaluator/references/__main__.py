"""python -m services.evaluator.references POLICY: scores a reference policy on levels; answers as `common.task` says.

What it says is what `services.evaluator.score` says of a checkpoint, with the policy's name besides.
"""

import argparse
from typing import get_args

from analysis.study import DRAWING, Reference
from common.levels.chunks import BankError
from common.levels.distributions import shipped
from common.levels.files import LevelFileError
from common.rail.compiled.world import CompiledWorld
from common.task import carry_out, say
from services.evaluator.references.policies import ORDERS, reference_policy
from services.evaluator.runner import UnplayableLevelError
from services.evaluator.score import add_levels, groups_of, played


def score(options: argparse.Namespace) -> None:
    """Score the policy on all groups of levels."""
    rows = []
    for group in groups_of(options, list(shipped())):
        world = CompiledWorld(1, group.most_trains)
        policy = reference_policy(options.policy, world, options.draws, options.orders)
        rows.append(played(group, policy, options.levels))
    say(
        {
            "checkpoint": None,
            "algorithm": None,
            "episode": None,
            "mode": None,
            "draws": options.draws if options.policy in DRAWING else None,
            "policy": options.policy,
            "orders": options.orders if options.policy == "planner" else None,
            "rows": rows,
        }
    )


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """What is asked for; none: on this process's own command line."""
    parser = argparse.ArgumentParser(description="Scores a reference policy.")
    parser.add_argument("policy", choices=get_args(Reference))
    parser.add_argument("--draws", type=int, default=0, help="seed of what the policy draws")
    parser.add_argument("--orders", type=int, default=ORDERS, help="of trains, that the planner tries")
    add_levels(parser)
    return parser.parse_args(arguments)


def main() -> None:
    options = parsed()
    carry_out(lambda: score(options), LevelFileError, BankError, UnplayableLevelError)


if __name__ == "__main__":
    main()
