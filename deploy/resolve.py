"""From what the user says to a checked configuration: preset, then file, then options, then `--set`."""

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from railctl.common.config import (
    MAX_ACTORS,
    MAX_LAG,
    MAX_STALENESS,
    PATHS,
    RunConfig,
    home_of,
    homes_of,
    parse_config,
    upgraded,
)
from railctl.common.levels.distributions import LEVEL_PATTERN, shipped
from railctl.common.mapping_file import read_mapping
from railctl.common.plain_yaml import DEEPEST, NotPlainYamlError, parse_yaml
from railctl.common.rules import rules, settings_of
from railctl.common.strict import ConfigError, brief, flat, nearest, section_of, shortened
from railctl.common.world import WorldSpec, checked_world, chosen_levels, read_world
from railctl.deploy.demonstrations import demonstrations_digest, with_demonstrations_read
from railctl.deploy.start import checkpoint_digest, with_start_read

Plain = dict[str, Any]
LEVEL_FORM = re.compile(LEVEL_PATTERN)
EVALUATION_LEVELS = 50  # unless fewer are kept from training


def algorithms() -> list[str]:
    """The names of all presets."""
    return sorted(
        path.name.removesuffix(".yaml")
        for path in files("railctl.deploy.presets").iterdir()
        if path.name.endswith(".yaml")
    )


def preset_of(algorithm: str) -> Plain:
    """A preset as its file has it.

    Raises:
        ConfigError: there is none of this name.
    """
    if algorithm not in algorithms():
        raise ConfigError(f"unknown algorithm {shortened(algorithm)}{nearest(algorithm, algorithms())}")
    return deepcopy(_read_preset(algorithm))


@cache
def _read_preset(algorithm: str) -> Plain:
    preset: Plain = yaml.safe_load((files("railctl.deploy.presets") / f"{algorithm}.yaml").read_text())
    return preset


def resolve(given: Plain, base: Path = Path()) -> RunConfig:
    """The configuration of a new run from what was given, on top of its algorithm's preset.

    Args:
        given: plain data, as a run file has it.
        base: where relative paths of level files and checkpoints begin.

    Raises:
        ConfigError: one line that names field, value and remedy.
    """
    algorithm, rule, given = understood(given)
    preset = preset_of(algorithm)
    by_level = preset.pop("by_level")
    given = _with_keys_found(given, base)
    own, mix = given.get("levels", {}), given.get("mix", {"easy": 1.0})
    chosen = chosen_levels(mix, own)
    check_levels(own)
    if own and "mix" not in given:
        name = min(own)
        raise ConfigError(f"levels: nothing says that {name} is played: add mix: {{{name}: 1}}, or choose level {name}")
    given["mix"] = mix
    world = read_world({"levels": chosen}, base)
    learning = laid_over(preset, by_level[_most_alike(world, list(by_level))])
    defaults = {
        "algorithm": algorithm,
        "episodes": 1500,
        # Where nothing is acted in parallel, an actor in a process of its own would only cost messages.
        "cluster": {"actors": dict.fromkeys(mix, int(bool(given.get("lag"))))},
        "evaluation": {
            "levels": min(EVALUATION_LEVELS, *(levels.evaluation_levels for levels in world.levels.values()))
        },
        **({"max_staleness": MAX_STALENESS} if given.get("lag") == "free" else {}),
    }
    adapted = settings_of(rule).adapted(learning, given.get("lag") or 0)
    merged = laid_over(laid_over(defaults, adapted), given)
    merged["levels"] = world.model_dump(mode="json")["levels"]
    if "actors" in given.get("cluster", {}):  # named actors replace the default ones, they do not add to them
        merged["cluster"]["actors"] = given["cluster"]["actors"]
    return with_demonstrations_read(with_start_read(parse_config(merged), base), base)


def understood(given: Plain) -> tuple[str, str, Plain]:
    """The algorithm of a run file, its rule, and the file's keys as this version has them, short forms written out.

    Raises:
        ConfigError: there is no such algorithm or rule, or a key is none of them, or no section where it should be.
    """
    given = upgraded(given)
    algorithm = _name("algorithm", given.get("algorithm", "dddqn"))
    rule = _name("rule", given.get("rule", preset_of(algorithm)["rule"]))
    given = spelled_out(given, rule)
    check_sections(given, rule)
    homes_of(given, rule)
    return algorithm, rule, given


def _most_alike(world: WorldSpec, names: Sequence[str]) -> str:
    """Of the levels that a preset has settings for, that with about as many trains."""
    trains = world.bounds.trains
    return min(names, key=lambda name: (abs(shipped()[name].trains - trains), shipped()[name].trains))


def check_levels(own: Plain) -> None:
    """Raises ConfigError if a run file's own levels are wrong, also those that its mix leaves out."""
    if own:
        checked_world({"levels": own})


def resolve_existing(saved: RunConfig, given: Plain, name: str, base: Path = Path()) -> RunConfig:
    """The configuration to go on with: the saved one, with another cluster if one is given.

    Raises:
        ConfigError: what is given would make another run of it.
    """
    given = spelled_out(upgraded(given), saved.rule)
    check_sections(given, saved.rule)
    given = _with_keys_found(given, base)
    _check_kinds(saved, given, name)
    kept = saved.plain()
    if "levels" in given:
        check_levels(given["levels"])
        own = {level: spec for level, spec in given["levels"].items() if level in saved.mix}
        given["levels"] = read_world({"levels": own}, base).model_dump(mode="json")["levels"] if own else {}
    merged = laid_over(kept, given | _beginnings(saved, given, base, name))
    merged["levels"] = kept["levels"] | given.get("levels", {})
    if "actors" in given.get("cluster", {}):
        merged["cluster"]["actors"] = given["cluster"]["actors"]
    if merged.get("lag") != saved.lag:  # so that what is wrong is the lag
        raise _another_run(name, f"lag {saved.lag}", str(merged.get("lag")))
    config = parse_config(merged)
    before, now = flat(saved.science), flat(config.science)
    for field in dict.fromkeys([*before, *now]):
        if before.get(field) != now.get(field):
            raise _another_run(name, f"{field} {before.get(field)}", str(now.get(field)))
    return config


def _with_keys_found(given: Plain, base: Path) -> Plain:
    """The same, and whoever reads it from another folder finds the keys."""
    cluster = given.get("cluster", {})
    if not isinstance(keys := cluster.get("keys"), str):
        return given
    return given | {"cluster": cluster | {"keys": str((base / keys).absolute())}}


def _beginnings(saved: RunConfig, given: Plain, base: Path, name: str) -> Plain:
    """The sections that are given of files that the run began with, as the run has them; it keeps its own copies.

    Raises:
        ConfigError: a file is there, and is another one.
    """
    found = {}
    for key, digest_of in (("start_from", checkpoint_digest), ("demonstrations", demonstrations_digest)):
        section, kept = given.get(key), saved.plain().get(key)
        if isinstance(section, dict) and isinstance(path := section.get(PATHS[key]), str) and kept is not None:
            there = base / path
            if there.exists() and digest_of(there) != kept["digest"]:
                raise _another_run(name, f"{key} of digest {kept['digest']}", path)
            found[key] = kept | {part: value for part, value in section.items() if part != PATHS[key]}
    return found


def _check_kinds(saved: RunConfig, given: Plain, name: str) -> None:
    """Refuse what decides which other keys there can be, before they are found missing or too many."""
    for key, before in (("algorithm", saved.algorithm), ("rule", saved.rule)):
        if given.get(key, before) != before:
            raise _another_run(name, f"{key} {before}", str(given[key]))
    if given.get("mix", saved.mix) != saved.mix:
        raise _another_run(name, _told(saved.mix), _told(given["mix"]))
    for key, section in saved.plain().items():
        kind = section.get("kind") if isinstance(section, dict) else None
        now = given.get(key, {}).get("kind", kind) if kind is not None else None
        if now != kind:
            raise _another_run(name, f"{key}.kind {kind}", str(now))


def _another_run(name: str, before: str, now: str) -> ConfigError:
    remedy = "leave the option out to go on with it, or give another --name"
    return ConfigError(f"run {name} exists with {before}, not {now}: {remedy}")


def _told(mix: Mapping[Any, float]) -> str:
    """As the user says it: `level easy`, or a mix."""
    return f"level {next(iter(mix))}" if list(mix.values()) == [1] else f"mix {dict(mix)}"


def spelled_out(given: Plain, rule: str) -> Plain:
    """Short forms written out: `level: easy` is `mix: {easy: 1}`, a name is the `kind` of a section that has kinds.

    >>> spelled_out({"level": "easy", "replay": "prioritized"}, "dqn")
    {'replay': {'kind': 'prioritized'}, 'mix': {'easy': 1.0}}

    Raises:
        ConfigError: both level and mix are given.
    """
    given = {key: _with_kind(str(key), value, rule) for key, value in given.items()}
    for name, file in PATHS.items():
        if isinstance(given.get(name), str):
            given[name] = {file: given[name]}
    level = given.pop("level", None)
    if level is None:
        return given
    if "mix" in given:
        raise ConfigError("level and mix are both given: leave one out")
    return given | {"mix": {_name("level", level): 1.0}}


def _name(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ConfigError(f"{key}: input should be a name, not {shortened(value)}")
    return value


def _with_kind(key: str, value: Any, rule: str) -> Any:
    section = _section(key, rule)
    return {"kind": value} if isinstance(value, str) and section and "kind" in section.model_fields else value


def _section(key: str, rule: str) -> type[BaseModel] | None:
    """The model of a key that is a section."""
    home = home_of(key, rule)
    return None if home is None else section_of(home.model_fields[key].annotation)


def check_sections(given: Plain, rule: str) -> None:
    """Raises ConfigError if something that has keys of its own was given as something else."""
    for name, value in given.items():
        if not isinstance(name, str):
            raise ConfigError(f"{brief(str(name))}: keys should be strings, not {shortened(name)}")
        is_section = name in ("mix", "levels") or _section(name, rule) is not None
        if is_section and not isinstance(value, dict) and not (name in PATHS and value is None):
            raise ConfigError(f"{name}: input should be a valid dictionary, not {shortened(value)}")


def read_file(path: Path) -> Plain:
    """A run file.

    Raises:
        ConfigError: it cannot be read, is not a mapping, or leaves a section empty, which options might complete.
    """
    data = read_mapping(path, "give an existing YAML file", "algorithm: dddqn")
    for name, value in upgraded(data).items():
        if value is None and _is_section(name):
            raise ConfigError(f"{path}: {name} is empty: give it keys, or leave it out")
    return data


def _is_section(name: Any) -> bool:
    """Whether a key has keys of its own, whatever the rule, and not those of a file that may be left out."""
    return name in ("mix", "levels") or (name not in PATHS and any(_section(name, rule) for rule in rules()))


def parse_sets(settings: Sequence[str]) -> Plain:
    """`a.b=1` as {"a": {"b": 1}}; of two settings of the same key the later one counts.

    Raises:
        ConfigError: a setting has no `=` or no value, or its value is not YAML.
    """
    result: Plain = {}
    for setting in settings:
        key, separator, value = setting.partition("=")
        if not separator or not key:
            example = "write for example --set dqn.batch_size=64"
            raise ConfigError(f"--set {shortened(setting)} is not key=value: {example}")
        if not value.strip():
            raise ConfigError(f"--set {shortened(setting)} has no value: give one, or null")
        parts = key.split(".")
        if len(parts) > DEEPEST:
            raise ConfigError(f"--set {shortened(key)}: no key has so many parts")
        try:
            plain = parse_yaml(value)
        except NotPlainYamlError as error:
            raise ConfigError(f"--set {brief(key)}: {shortened(value)} is not a YAML value: {error}") from None
        for part in reversed(parts):
            plain = {part: plain}
        result = merge(result, plain)
    return result


def parse_lag(text: str) -> int | str:
    """A number, or a word that the configuration knows or refuses.

    >>> parse_lag("3"), parse_lag("free")
    (3, 'free')
    """
    return int(text) if text.isascii() and text.isdigit() and len(text) <= len(str(MAX_LAG)) else text


def parse_actors(text: str) -> dict[str, int]:
    """`easy=2,hard=1` as counts.

    >>> parse_actors("easy=2,hard=1")
    {'easy': 2, 'hard': 1}

    Raises:
        ConfigError: the text is not of this form.
    """
    counts: dict[str, int] = {}
    for part in text.split(","):
        level, separator, count = part.strip().partition("=")
        if not separator or not level or not (count.isascii() and count.isdigit()):
            raise ConfigError(f"actors {shortened(part)} is not level=count: write for example easy=2,hard=1")
        if LEVEL_FORM.fullmatch(level) is None:
            raise ConfigError(
                f"actors {shortened(part)}: a level's name has letters, digits, '.', '_' and '-', at most 40"
            )
        if level in counts:
            raise ConfigError(f"actors {shortened(part)}: {level} is there twice, leave one out")
        if len(count) > 3 or int(count) > MAX_ACTORS:
            raise ConfigError(f"actors {shortened(part)}: at most {MAX_ACTORS} of a level")
        counts[level] = int(count)
    return counts


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> Plain:
    """What the user said in two places, `above` over `below`.

    Raises:
        ConfigError: a mapping would cover something that is none.
    """
    _check_covers(below, above, "")
    return laid_over(below, above)


def _check_covers(below: Mapping[str, Any], above: Mapping[str, Any], path: str) -> None:
    """Raises as `merge`; both lie at `path`, as an error names it."""
    for key, value in above.items():
        under = below.get(key)
        if not isinstance(value, dict) or under is None:
            continue
        if not isinstance(under, dict):
            both = f"{shortened(under, 30)} and {shortened(value, 30)}"
            raise ConfigError(f"{path}{key}: cannot be both {both}: give one of them")
        _check_covers(under, value, f"{path}{key}.")


def laid_over(below: Mapping[str, Any], above: Mapping[str, Any]) -> Plain:
    """`above` laid over `below`, mapping by mapping."""
    result = dict(below)
    for key, value in above.items():
        under = result.get(key)
        result[key] = laid_over(under, value) if isinstance(under, dict) and isinstance(value, dict) else value
    return result
