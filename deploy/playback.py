"""Having a policy play one level for looking at; `services.evaluator.playback` does it."""

from pathlib import Path
from typing import Any

from railctl.common.requests import LevelChoice, PlaybackRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.references import REFERENCES, check_orders, check_reference, found_checkpoint
from railctl.deploy.task import run_task

PLAYER = "railctl.services.evaluator.playback"


def play_back(request: PlaybackRequest) -> dict[str, Any]:
    """Have the document written; what the process says of it.

    Raises:
        ConfigError: it was asked for what cannot be.
        Failed: it failed.
    """
    return run_task(PLAYER, request.model_dump_json())


def playback_request(  # noqa: PLR0913  (who plays what, and how)
    policy: str,
    levels: LevelChoice,
    number: int,
    file: Path,
    *,
    sample: bool | None = None,
    draws: int | None = None,
    orders: int | None = None,
    observations: bool = True,
) -> PlaybackRequest:
    """What is asked for by a name that `railctl evaluate` takes.

    Raises:
        ConfigError, Failed: there is no such policy, or an option is of no use to it.
    """
    given: dict[str, Any] = {"levels": levels, "number": number, "file": file, "observations": observations}
    if draws is not None:
        given["draws"] = draws
    if policy in REFERENCES:
        check_reference(policy, draws, orders, sample=sample)
        return PlaybackRequest.model_validate(given | {"policy": policy} | ({"orders": orders} if orders else {}))
    check_orders(policy, orders)
    if draws is not None and sample is False:
        raise ConfigError(f"--draws {draws} and --greedy: greedy play draws nothing, leave one of them out")
    mode = None if sample is None else "sample" if sample else "greedy"
    return PlaybackRequest.model_validate(given | {"checkpoint": found_checkpoint(policy), "mode": mode})
