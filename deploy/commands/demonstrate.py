"""railctl demonstrate: write to a file how a policy plays the training levels of a run."""

from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from railctl.common.levels.bank import bank_root
from railctl.common.requests import MOST_EPISODES, DemonstrationRequest, Demonstrator
from railctl.common.strict import ConfigError
from railctl.deploy.commands.references import check_orders, found_checkpoint
from railctl.deploy.commands.run_options import without_none
from railctl.deploy.levels import prepare_levels
from railctl.deploy.output import AsJson, check_free, counted, one_line_errors, say
from railctl.deploy.resolve import algorithms, merge, parse_sets, read_file, resolve
from railctl.deploy.runs import runs_root
from railctl.deploy.task import run_task

WRITER = "railctl.services.evaluator.demonstrate"
DEMONSTRATORS: tuple[str, ...] = get_args(Demonstrator)
EPISODES = 100


@one_line_errors
def demonstrate(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY|CHECKPOINT",
            help=f"{', '.join(DEMONSTRATORS)}; or a .safetensors file, or a run: its newest checkpoint.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="What to write; it must not exist yet.")],
    file: Annotated[
        Path | None, typer.Option("--file", "-f", help="Run file (YAML) with the world to play in.")
    ] = None,
    algorithm: Annotated[str | None, typer.Option(help=f"Preset: {', '.join(algorithms())}; default: dddqn.")] = None,
    level: Annotated[
        str | None, typer.Option(help="Name of levels that ship, or of the run file; default: easy.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of the run whose levels are played; default: 1.")] = None,
    episodes: Annotated[int, typer.Option(help="How many, from the run's first.")] = EPISODES,
    orders: Annotated[
        int | None, typer.Option(help="Of trains, planners carry out the best plan of so many; default: 50.")
    ] = None,
    sample: Annotated[
        bool | None,
        typer.Option("--sample/--greedy", help="How a checkpoint acts; default: as its run scores it."),
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Any setting of the run, as interlocking=planned.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write episodes that a policy plays on the training levels of a run, for others to learn."""
    _check(policy, episodes, orders, out, sample=sample)
    given: dict[str, Any] = {} if file is None else read_file(file)
    given.pop("demonstrations", None)  # perhaps those that are to be written
    base = Path() if file is None else file.parent
    if level is not None:
        given.pop("mix", None)  # options go before the file
    options = without_none({"algorithm": algorithm, "level": level, "seed": seed})
    config = resolve(merge(merge(given, options), parse_sets(settings or [])), base)
    is_reference = policy in DEMONSTRATORS
    checkpoint = None if is_reference else found_checkpoint(policy)
    bank = bank_root(runs_root())
    prepare_levels(config.world.levels, bank, config.cluster.cores)
    request = {
        "policy": policy if is_reference else None,
        "checkpoint": checkpoint,
        "mode": None if sample is None else "sample" if sample else "greedy",
        "orders": orders,
        "episodes": episodes,
        "base": base.resolve(),
        "bank": bank,
        "file": out,
    }
    checked = DemonstrationRequest.model_validate(without_none(request) | {"config": config.plain()})
    result = run_task(WRITER, checked.model_dump_json())
    text = (
        f"{result['file']}: {counted(result['episodes'], 'episode')} of {result['policy']}, "
        f"{counted(result['decisions'], 'decision')}; mean return {result['mean']:.3f}, "
        f"{result['arrived_share']:.1%} of the trains arrived"
    )
    say(text, result, as_json=as_json)


def _check(policy: str, episodes: int, orders: int | None, out: Path, *, sample: bool | None) -> None:
    """Raise ConfigError if the options do not go together."""
    if not 1 <= episodes <= MOST_EPISODES:
        raise ConfigError(f"--episodes {episodes}: use 1 to {MOST_EPISODES}")
    check_orders(policy, orders)
    if sample is not None and policy in DEMONSTRATORS:
        raise ConfigError(
            f"--{'sample' if sample else 'greedy'}: {policy} is no network whose actions could be drawn, or the best: "
            "leave it out"
        )
    check_free(out, f"--out {out}")
