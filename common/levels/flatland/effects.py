"""What flatland-rl's files say happens to trains: malfunctions, which a level can say, and other effects."""

from typing import Any

from railctl.common.levels.files import LATEST, LevelFileError
from railctl.common.levels.flatland.inert import NotPlainError, Stub, number, sequence, whole
from railctl.common.levels.level import Malfunctions

MALFUNCTIONS = "MalfunctionEffectsGenerator"
SEVERAL = "MultiEffectsGeneratorWrapped"
HARMLESS = {"EffectsGenerator", "RecordStepsEffectsGenerator", MALFUNCTIONS}
MOST_EFFECTS = 100


def malfunctions(content: dict[str, Any]) -> tuple[Malfunctions | None, list[str]]:
    """What breaks trains down, and notes of what a level cannot say.

    The effects of 4.2 and later say all, if they are there; before them the parameters stood alone.

    Raises:
        LevelFileError: the parameters are none.
        NotPlainError: neither are the effects.
    """
    effects = content.get("effects_generator")
    if effects is None:
        parameters = content.get("malfunction")
        if parameters is None:
            return None, []
        return _parameters(parameters.arguments if isinstance(parameters, Stub) else sequence(parameters, 3))
    found: Malfunctions | None = None
    notes: list[str] = []
    for name, options in _flat(effects):
        given = options.get("param_malfunction_gen")
        if name == MALFUNCTIONS and isinstance(given, dict):
            keys = "malfunction_rate", "min_duration", "max_duration"
            if found is not None:
                raise LevelFileError("has several kinds of malfunctions, which is not supported")
            found, more = _parameters([given[key] for key in keys])
            notes += more
        elif name not in HARMLESS:
            notes.append(f"left out: effects of {name}" if name.isidentifier() else "left out: effects without a name")
    return found, list(dict.fromkeys(notes))


def _flat(effects: Any) -> list[tuple[str, dict[str, Any]]]:
    """Class names and options of all effects of a file."""
    found: list[tuple[str, dict[str, Any]]] = []
    left = [effects]
    while left:
        effect = left.pop()
        if not isinstance(effect, dict) or len(found) + len(left) > MOST_EFFECTS:
            raise NotPlainError("effects that are none, or too many")
        specs = effect.get("specs") or {}
        name = str(effect["cls"]).rpartition(".")[2]
        if name == SEVERAL:
            left += reversed(sequence(specs.get("args", []), MOST_EFFECTS))
            found.append((MALFUNCTIONS, {}))  # counts, and says nothing
        else:
            found.append((name, specs.get("kwargs") or {}))
    return found


def _parameters(values: Any) -> tuple[Malfunctions | None, list[str]]:
    """Rate, least and most steps. Before 2.2 the rate was the steps from one malfunction to the next."""
    rate = float(number(values[0]))
    if rate <= 0:
        return None, []
    shortest, longest = (whole(value, 0, LATEST) for value in values[1:])
    if shortest > longest or not rate < LATEST:
        raise LevelFileError(f"has malfunctions of rate {rate:g} for {shortest} to {longest} steps: give them a range")
    if rate <= 1:
        return Malfunctions(rate, shortest, longest), []
    note = f"a malfunction rate of {rate:g}: taken as the steps from one to the next, as before 2.2"
    return Malfunctions(1 / rate, shortest, longest), [note]
