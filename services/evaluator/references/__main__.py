"""python -m railctl.services.evaluator.references REQUEST: scores a reference policy on levels; answers as `common.task` says.

It answers what `services.evaluator.score` answers of a checkpoint, with the policy's name besides.
"""

from railctl.common.levels.chunks import BankError
from railctl.common.levels.files import LevelFileError
from railctl.common.policy.player import compiled_world
from railctl.common.requests import DRAWING, PLANNING, ReferenceRequest, asked
from railctl.common.task import carry_out, say
from railctl.services.evaluator.groups import groups_of, known_to_all
from railctl.services.evaluator.references.policies import reference_policy, reference_world
from railctl.services.evaluator.runner import UnplayableLevelError
from railctl.services.evaluator.score import played


def score(request: ReferenceRequest) -> None:
    """Score the policy on all groups of levels."""
    known = known_to_all(request.levels)
    conditions = reference_world(request.policy, known.levels)
    rows = []
    for group in groups_of(request.levels, known):
        world = compiled_world(conditions, group.rules, group.most_trains)
        policy = reference_policy(request.policy, world, request.draws, request.orders)
        rows.append(played(group, policy, request.levels.file))
    say(
        {
            "checkpoint": None,
            "algorithm": None,
            "episode": None,
            "mode": None,
            "draws": request.draws if request.policy in DRAWING else None,
            "policy": request.policy,
            "orders": request.orders if request.policy in PLANNING else None,
            "rows": rows,
        }
    )


def main() -> None:
    carry_out(lambda: score(asked(ReferenceRequest)), LevelFileError, BankError, UnplayableLevelError)


if __name__ == "__main__":
    main()
