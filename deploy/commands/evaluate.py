"""railctl evaluate: score a checkpoint or a reference policy on levels that training never sees, or on given ones."""

from pathlib import Path
from typing import Annotated, Any

import typer

from railctl.common.levels.bank import bank_root
from railctl.common.requests import EPISODES, LevelChoice, ReferenceRequest, ScoreRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.references import REFERENCE_SCORER, REFERENCES, check_reference, found_checkpoint, heading
from railctl.deploy.levels import levels_of_run_file
from railctl.deploy.output import AsJson, console, one_line_errors, print_table, say
from railctl.deploy.runs import runs_root
from railctl.deploy.show import score_table
from railctl.deploy.task import run_task

SCORER = "railctl.services.evaluator.score"
SEED = 0


@one_line_errors
def evaluate(
    checkpoint: Annotated[
        str,
        typer.Argument(
            metavar="CHECKPOINT|POLICY",
            help="A .safetensors file, one that ships (pretrained/dispatch-hard), a run: its newest; or a policy: "
            + ", ".join(REFERENCES)
            + ".",
        ),
    ],
    level: Annotated[
        list[str] | None,
        typer.Option(
            help="Levels that ship, those that it was trained on, or of --file; or a group of --levels; may be "
            "repeated; default: what it was trained on, for a reference policy all that ship, or all groups."
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(help=f"Evaluation levels of each; default: {EPISODES}, or all there are.")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Of the levels; default: 0, whose levels all runs are evaluated on."),
    ] = None,
    levels: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Play the levels of a file instead: .npz, or flatland-rl's.")
    ] = None,
    sample: Annotated[
        bool | None,
        typer.Option(
            "--sample/--greedy",
            help="Draw actions as the policy's probabilities say, or take the best; default: as its run scores it.",
        ),
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(help="Seed of what --sample, random and planners draw; default: the run's, for the policies 0."),
    ] = None,
    orders: Annotated[
        int | None, typer.Option(help="Of trains, planners carry out the best plan of so many; default: 50.")
    ] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="Run file (YAML) with levels of your own.")] = None,
    as_json: AsJson = False,
) -> None:
    """Play levels with a checkpoint or a reference policy, and print what becomes of them.

    A row a level distribution, with its 95% interval.
    """
    is_reference = checkpoint in REFERENCES
    if is_reference:
        check_reference(checkpoint, draws, orders, sample=sample)
    elif orders is not None:
        raise ConfigError("--orders: only planners try orders of trains: leave it out")
    _check(levels, episodes, seed, draws, file, sample=sample)
    choice = LevelChoice(
        names=tuple(dict.fromkeys(level)) if level else None,
        own=levels_of_run_file(file) if file else {},
        base=file.parent.resolve() if file else Path(),
        file=levels,
        episodes=episodes,
        seed=seed or SEED,
        bank=bank_root(runs_root()),
    )
    result = (
        _scored_reference(checkpoint, draws, orders, choice)
        if is_reference
        else _scored(checkpoint, sample, draws, choice)
    )
    say(heading(result), result, as_json=as_json)
    if not as_json:
        print_table(score_table(result["rows"]))
        console.print("return: normalised, mean over levels; low, high: its 95% interval (bootstrap)")
        if seed and levels is None and not is_reference:
            console.print(f"training may know rails of the levels of seed {seed}; those of seed 0 it never sees")


def _scored(name: str, sample: bool | None, draws: int | None, choice: LevelChoice) -> dict[str, Any]:
    request = ScoreRequest(
        checkpoint=found_checkpoint(name),
        mode=None if sample is None else "sample" if sample else "greedy",
        draws=draws,
        levels=choice,
    )
    return run_task(SCORER, request.model_dump_json())


def _scored_reference(policy: str, draws: int | None, orders: int | None, choice: LevelChoice) -> dict[str, Any]:
    given = {"draws": draws, "orders": orders}
    request = ReferenceRequest.model_validate(
        {"policy": policy, "levels": choice} | {key: value for key, value in given.items() if value is not None}
    )
    return run_task(REFERENCE_SCORER, request.model_dump_json())


def _check(
    levels: Path | None,
    episodes: int | None,
    seed: int | None,
    draws: int | None,
    file: Path | None,
    *,
    sample: bool | None,
) -> None:
    """Raise ConfigError if the options do not go together."""
    if episodes is not None and episodes < 1:
        raise ConfigError(f"--episodes {episodes}: use a number above 0")
    if seed is not None and seed < 0:
        raise ConfigError(f"--seed {seed}: use 0 or a number above")
    if draws is not None and draws < 0:
        raise ConfigError(f"--draws {draws}: use 0 or a number above")
    if draws is not None and sample is False:
        raise ConfigError(f"--draws {draws} and --greedy: greedy play draws nothing, leave one of them out")
    if levels is None:
        return
    if not levels.is_file():
        raise ConfigError(f"--levels {levels}: no such file")
    if episodes is not None:
        raise ConfigError(f"--levels and --episodes: all levels of {levels} are played, leave --episodes out")
    if seed is not None:
        raise ConfigError("--levels and --seed: given levels are not drawn, leave --seed out (--draws is of sampling)")
    if file is not None:
        raise ConfigError(f"--levels and -f: the levels come out of {levels}, leave -f out")
