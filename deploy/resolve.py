"""From what the user says to a checked configuration: preset, then file, then options, then `--set`."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from common.config import DIFFICULTIES, MAX_ACTORS, RunConfig, parse_config
from common.strict import ConfigError, flat, nearest, section_of

Plain = dict[str, Any]
OPTIONAL_SECTIONS = ("dqn", "ppo", "sil", "replay")  # an algorithm has those that its preset has


def algorithms() -> list[str]:
    """The names of all presets."""
    return sorted(
        path.name.removesuffix(".yaml") for path in files("deploy.presets").iterdir() if path.name.endswith(".yaml")
    )


def rules() -> list[str]:
    """The names of all update rules: the files of the learner's algorithms, looked at but not imported."""
    folder = Path(__file__).parents[1] / "services" / "learner" / "algorithms"
    return sorted(path.stem for path in folder.glob("[a-z]*.py"))


def resolve(given: Plain) -> RunConfig:
    """The configuration of a new run from what was given, on top of its algorithm's preset.

    Raises:
        ConfigError: one line that names field, value and remedy.
    """
    algorithm = str(given.get("algorithm", "dddqn"))
    if algorithm not in algorithms():
        raise ConfigError(f"unknown algorithm {algorithm!r}{nearest(algorithm, algorithms())}")
    preset: Plain = yaml.safe_load((files("deploy.presets") / f"{algorithm}.yaml").read_text())
    by_level = preset.pop("levels")
    given = spelled_out(given)
    check_sections(given)
    has = ", ".join(name for name in OPTIONAL_SECTIONS if name in preset)
    for section in OPTIONAL_SECTIONS:
        if section in given and section not in preset:
            raise ConfigError(f"algorithm {algorithm} has no section {section}: it has {has}")
    mix = given.setdefault("mix", {"easy": 1.0})
    hardest = max((level for level in mix if level in DIFFICULTIES), key=DIFFICULTIES.index, default="easy")
    defaults = {
        "algorithm": algorithm,
        "episodes": 1500,
        "cluster": {"actors": dict.fromkeys(mix, 1)},
    }
    merged = merge(merge(merge(defaults, preset), by_level[hardest]), given)
    if merged.get("rule") not in rules():
        raise ConfigError(f"unknown rule {merged.get('rule')!r}{nearest(str(merged.get('rule')), rules())}")
    if merged.get("lag") and "fragment_steps" not in given:
        merged["fragment_steps"] = None  # the preset's; several episodes at a time are whole ones
    if "actors" in given.get("cluster", {}):  # named actors replace the default ones, they do not add to them
        merged["cluster"]["actors"] = given["cluster"]["actors"]
    return parse_config(merged)


def resolve_existing(saved: RunConfig, given: Plain, name: str) -> RunConfig:
    """The configuration to go on with: the saved one, with another cluster if one is given.

    Raises:
        ConfigError: what is given would make another run of it.
    """
    given = spelled_out(given)
    check_sections(given)
    if given.get("mix", saved.mix) != saved.mix:  # before its actors, which would be missed
        raise _another_run(name, _told(saved.mix), _told(given["mix"]))
    merged = merge(saved.model_dump(mode="json"), given)
    if merged.get("lag") and "fragment_steps" not in given:
        merged["fragment_steps"] = None  # so that what is wrong is the lag
    if "actors" in given.get("cluster", {}):
        merged["cluster"]["actors"] = given["cluster"]["actors"]
    config = parse_config(merged)
    for field, before in flat(saved.science).items():
        now = flat(config.science).get(field)
        if now != before:
            raise _another_run(name, f"{field} {before}", str(now))
    return config


def _another_run(name: str, before: str, now: str) -> ConfigError:
    remedy = "leave the option out to go on with it, or give another --name"
    return ConfigError(f"run {name} exists with {before}, not {now}: {remedy}")


def _told(mix: Mapping[Any, float]) -> str:
    """As the user says it: `level easy`, or a mix."""
    return f"level {next(iter(mix))}" if list(mix.values()) == [1] else f"mix {dict(mix)}"


def spelled_out(given: Plain) -> Plain:
    """`level: easy` is short for `mix: {easy: 1}`, `replay: prioritized` for `replay: {kind: prioritized}`.

    Raises:
        ConfigError: both level and mix are given, or the level is unknown.
    """
    given = dict(given)
    if isinstance(given.get("replay"), str):
        given["replay"] = {"kind": given["replay"]}
    level = given.pop("level", None)
    if level is None:
        return given
    if "mix" in given:
        raise ConfigError("level and mix are both given: leave one out")
    if level not in DIFFICULTIES:
        raise ConfigError(f"unknown level {level!r}{nearest(str(level), list(DIFFICULTIES))}")
    return given | {"mix": {level: 1.0}}


def check_sections(given: Plain) -> None:
    """Raises ConfigError if something that has keys of its own was given as something else."""
    for name, field in RunConfig.model_fields.items():
        is_section = name == "mix" or section_of(field.annotation) is not None
        if is_section and name in given and not isinstance(given[name], dict):
            raise ConfigError(f"{name}: input should be a valid dictionary, not {given[name]!r}")


def read_file(path: Path) -> Plain:
    """A run file.

    Raises:
        ConfigError: it cannot be read, or is not a mapping.
    """
    try:
        data = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}: give an existing YAML file with -f") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no text, or a date or number that cannot be
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{path} holds no keys: write for example 'algorithm: dddqn'")
    return data


def parse_sets(settings: Sequence[str]) -> Plain:
    """`a.b=1` as {"a": {"b": 1}}.

    Raises:
        ConfigError: a setting has no `=` or its value is not YAML.
    """
    result: Plain = {}
    for setting in settings:
        key, separator, value = setting.partition("=")
        if not separator or not key:
            raise ConfigError(f"--set {setting!r} is not key=value: write for example --set dqn.batch_size=64")
        try:
            plain: Any = yaml.safe_load(value)
        except (yaml.YAMLError, ValueError):
            raise ConfigError(f"--set {key}: {value!r} is not a YAML value") from None
        for part in reversed(key.split(".")):
            plain = {part: plain}
        result = merge(result, plain)
    return result


def parse_actors(text: str) -> dict[str, int]:
    """`easy=2,hard=1` as counts.

    >>> parse_actors("easy=2,hard=1")
    {'easy': 2, 'hard': 1}

    Raises:
        ConfigError: the text is not of this form.
    """
    counts = {}
    for part in text.split(","):
        level, separator, count = part.strip().partition("=")
        if not separator or not (count.isascii() and count.isdigit()):
            raise ConfigError(f"actors {part!r} is not difficulty=count: write for example easy=2,hard=1")
        if level not in (*DIFFICULTIES, "any"):
            raise ConfigError(f"actors for unknown difficulty {level!r}{nearest(level, [*DIFFICULTIES, 'any'])}")
        if len(count) > 3 or int(count) > MAX_ACTORS:
            raise ConfigError(f"actors {part!r}: at most {MAX_ACTORS} of a difficulty")
        counts[level] = int(count)
    return counts


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> Plain:
    """`above` laid over `below`, mapping by mapping."""
    result = dict(below)
    for key, value in above.items():
        under = result.get(key)
        result[key] = merge(under, value) if isinstance(under, dict) and isinstance(value, dict) else value
    return result
