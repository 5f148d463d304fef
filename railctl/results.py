"""What becomes of the levels that a policy plays."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from railctl.common.levels.bank import bank_root
from railctl.common.requests import LevelChoice, ReferenceRequest, ScoreRequest
from railctl.common.rules.settings import Mode
from railctl.common.strict import ConfigError, Strict, describe
from railctl.deploy.commands.evaluate import SCORER
from railctl.deploy.commands.references import REFERENCE_SCORER, REFERENCES, check_reference, found_checkpoint
from railctl.deploy.levels import levels_of_run_file
from railctl.deploy.runs import runs_root
from railctl.deploy.task import run_task
from railctl.given import path_of, text_of
from railctl.policies import Policy
from railctl.trained import Run

R = TypeVar("R", bound=Strict)


@dataclass(frozen=True)
class Evaluation:
    """The figures of a policy on L levels. Returns are normalised: -1 is the worst.

    Attributes:
        policy: its name.
        level: the name of the levels.
        mode: `greedy` or `sample`; None for reference policies.
        returns: [L], a level each.
        mean_return: of the levels.
        low, high: the 95% interval of the mean (bootstrap); None for a single level.
        arrived_share: of the trains, mean over levels.
        all_arrived_share: of the levels on which all trains arrived.
        mean_steps: environment steps of an episode.
        score: flatland-rl 4.3.0's own, mean over levels; None if the levels have other rules.
    """

    policy: str
    level: str
    mode: Mode | None
    returns: NDArray[np.float64] = field(repr=False)
    mean_return: float
    low: float | None
    high: float | None
    arrived_share: float
    all_arrived_share: float
    mean_steps: float
    score: float | None

    def __repr__(self) -> str:
        levels = f"{len(self.returns)} levels of {self.level}"
        share = f"{100 * self.arrived_share:.1f}% of the trains arrived"
        return f"Evaluation({self.policy!r} on {levels}: return {self.mean_return:.3f}, {share})"


def scored(  # noqa: PLR0913
    policy: Policy | Run | str | Path,
    level: str | None,
    episodes: int | None,
    *,
    mode: Mode | None,
    seed: int,
    levels: Path | str | None,
    run_file: Path | str | None,
    progress: bool,
) -> Evaluation:
    """See `railctl.evaluate`."""
    if levels is not None and (episodes is not None or seed or run_file is not None):
        raise ConfigError(
            f"levels={str(levels)!r}: the file says which levels there are: leave out episodes, seed and run_file"
        )
    name = policy.name if isinstance(policy, (Policy, Run)) else str(policy)
    is_reference = isinstance(policy, str) and policy in REFERENCES
    first = None if levels is not None else "easy" if is_reference else _first_level(policy)
    wanted = first if level is None else text_of("level", level)
    file = path_of("run_file", run_file)
    choice = _checked(
        LevelChoice,
        names=None if wanted is None else (wanted,),
        own={} if file is None else levels_of_run_file(file),
        base=Path() if file is None else file.parent.resolve(),
        file=path_of("levels", levels),
        episodes=episodes,
        seed=seed,
        bank=bank_root(runs_root()),
    )
    request: ReferenceRequest | ScoreRequest
    if is_reference:
        check_reference(name, None, None, sample=None if mode is None else mode == "sample")
        request = ReferenceRequest.model_validate({"policy": name, "levels": choice})
    else:
        request = _checked(ScoreRequest, checkpoint=_checkpoint_of(policy), mode=mode, levels=choice)
    module = REFERENCE_SCORER if is_reference else SCORER
    result = run_task(module, request.model_dump_json(), shows=progress)
    return _evaluation(name, result)


def _checked(model: type[R], **fields: Any) -> R:
    """A part of a request; raises ConfigError."""
    try:
        return model(**fields)
    except ValidationError as error:
        raise ConfigError(describe(error, model)) from None


def _first_level(policy: Policy | Run | str | Path) -> str:
    known = policy if isinstance(policy, (Policy, Run)) else Policy(policy)
    return next(iter(known.config.mix))


def _checkpoint_of(policy: Policy | Run | str | Path) -> Path:
    if isinstance(policy, Policy):
        return policy.path
    return policy.checkpoint if isinstance(policy, Run) else found_checkpoint(str(policy))


def _evaluation(name: str, result: dict[str, Any]) -> Evaluation:
    row = result["rows"][0]
    return Evaluation(
        policy=name,
        level=row["level"],
        mode=result.get("mode"),
        returns=np.array(row["returns"]),
        mean_return=row["mean"],
        **{key: row[key] for key in ("low", "high", "arrived_share", "all_arrived_share", "mean_steps", "score")},
    )
