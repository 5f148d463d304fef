"""Table 5.3, and every other setting: what runs were made with, and where that is not what the study had."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from railctl.analysis.report.parts import Listing, Part, Section
from railctl.analysis.report.published import HYPERPARAMETERS, hyperparameters
from railctl.analysis.report.results import Results
from railctl.analysis.report.tables import Beside, Cell, Column, Table
from railctl.common.config import RunConfig
from railctl.common.strict import flat

IN_TABLE = ("learning_rate", "batch_size", "learn_every_steps", "capacity", "epochs", "hidden")
OF_RUNS = ("algorithm", "seed", "mix", "levels")


def settings(results: Results) -> Section:
    """What every contender is."""
    configs = {
        (level, name): config
        for level in results.levels
        for name in results.contenders
        if (config := next((trained.config for trained in results.cell(name, level) if trained.config), None))
    }
    if not configs:
        return Section("Settings", ("No run has been started yet.",))
    parts: list[Part] = [_table(configs), *_differences(results, configs), _levels(configs), _others(results, configs)]
    return Section("Settings", tuple(parts))


def ours(config: RunConfig) -> dict[str, str]:
    """The hyperparameters of the study's table 5.3, as this run has them; a rule of one's own may lack some."""
    plain = config.plain()
    values, policy, imitation, replay = (plain.get(name, {}) for name in ("dqn", "ppo", "sil", "replay"))
    found = {"hidden": "/".join(map(str, plain["network"].get("hidden", [])))}
    for section in (values, policy):
        if "learning_rate" in section:
            found["learning rate"] = np.format_float_positional(section["learning_rate"], trim="-")
    if values:
        found |= {"batch": str(values["batch_size"]), "learn every": f"{values['learn_every_steps']} steps"}
    if policy:
        drawn = (imitation or policy).get("batch_size", "episode")
        epochs = " + ".join(str(section["epochs"]) for section in (policy, imitation) if section)
        found |= {"batch": str(drawn), "learn every": "episode", "epochs": epochs}
    if replay:
        found["buffer"] = str(replay["capacity"])
    return found


def _beside(level: str, name: str, config: RunConfig) -> list[Beside]:
    here, study = ours(config), hyperparameters(level, name)
    return [Beside(here.get(key), study.get(key)) for key in HYPERPARAMETERS]


def _table(configs: dict[tuple[str, str], RunConfig]) -> Table:
    rows: list[list[Cell]] = [[level, name, *_beside(level, name, config)] for (level, name), config in configs.items()]
    caption = (
        "Hyperparameters of each contender; in brackets the study's, where it has another value. Contenders that are "
        "not in the study's table 5.3 stand alone. Epochs of sil are those of its ppo updates and of imitation."
    )
    headings = ("level", "contender", *HYPERPARAMETERS)
    return Table("table-5.3", "Table 5.3: hyperparameters", caption, tuple(map(Column, headings)), rows)


def _differences(results: Results, configs: dict[tuple[str, str], RunConfig]) -> Iterator[Part]:
    """What was switched on purpose, and what is not as in the study."""
    lines = []
    if results.study is not None:
        if results.study.settings:
            lines.append(f"All runs: {_spoken(results.study.settings)}.")
        lines += [
            f"{contender.name}: {contender.algorithm} with {_spoken(contender.settings)}."
            for contender in results.study.contenders
            if contender.settings
        ]
    for (level, name), config in configs.items():
        differing = [
            f"{key} {beside.ours or 'none'} in place of {beside.study}"
            for key, beside in zip(HYPERPARAMETERS, _beside(level, name, config), strict=True)
            if beside.study not in (None, beside.ours)
        ]
        if differing:
            lines.append(f"{name} on {level}: {', '.join(differing)}.")
    yield (
        "What was switched, and what is not as in the study's table:"
        if lines
        else "No setting was switched, and all hyperparameters that the study gives are as in its table."
    )
    if lines:
        yield Listing(tuple(lines))


def _spoken(given: dict[str, Any]) -> str:
    return ", ".join(f"{key}={_value(value)}" for key, value in flat(given).items())


def _value(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _levels(configs: dict[tuple[str, str], RunConfig]) -> Table:
    """What is played."""
    rows: dict[str, list[Cell]] = {}
    for config in configs.values():
        for name, levels in config.world.levels.items():
            height, width, trains = levels.bounds
            others = flat(levels.model_dump(mode="json", exclude={"rules", "size", "trains"}, exclude_none=True))
            spoken = ", ".join(f"{key} {_value(value)}" for key, value in others.items())
            rows[f"{name} {levels.identity}"] = [name, levels.rules, f"{height}x{width}", str(trains), spoken]
    columns = tuple(map(Column, ("level", "rules", "size", "trains", "else")))
    caption = "The level distributions: rules are those of flatland 2.2.2 (legacy) or flatland-rl 4.3.0 (stock)."
    return Table("table-levels", "Levels", caption, columns, list(rows.values()))


def _others(results: Results, configs: dict[tuple[str, str], RunConfig]) -> Table:
    """A row a setting, a column a contender; where levels differ, all their values."""
    values: dict[str, dict[str, dict[str, str]]] = {}
    for (level, name), config in configs.items():
        for key, value in flat(config.science).items():
            if key.split(".")[0] not in OF_RUNS and key.split(".")[-1] not in IN_TABLE:
                values.setdefault(key, {}).setdefault(name, {})[level] = _value(value)
    rows = [
        [key, *(_by_level(by_name.get(name, {})) for name in results.contenders)] for key, by_name in values.items()
    ]
    caption = "All other settings that decide a run's curve, under their names in a run file."
    columns = (Column("setting"), *map(Column, results.contenders))
    return Table("table-settings", "Other settings", caption, columns, rows, is_folded=True)


def _by_level(values: dict[str, str]) -> str | None:
    distinct = set(values.values())
    if len(distinct) > 1:
        return ", ".join(f"{level} {value}" for level, value in values.items())
    return distinct.pop() if distinct else None
