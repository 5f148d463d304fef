"""What all settings share: frozen models, one line for whatever is wrong with them, and hints at what is known."""

import difflib
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    ValidatorFunctionWrapHandler,
)
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from railctl.common.text import is_text

Share = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_WORDS = {  # of pydantic, and those of who writes YAML
    "a valid tuple": "a list",
    "Tuple should have": "Input should be a list of",
    "Dictionary should have": "Input should be a dictionary of",
}
LARGEST = 2**53 - 1  # of whole numbers, if a field does not say


class ConfigError(ValueError):
    r"""Bad input from the user: the message names the field, the value and the remedy, in one line.

    >>> str(ConfigError("unknown key a\nb"))
    'unknown key a\\nb'
    """

    def __init__(self, text: str) -> None:
        """`text` may hold names of the user's with anything in them."""
        super().__init__("".join(each if each.isprintable() else ascii(each)[1:-1] for each in text))


def check_is_text(folder: str, given: str) -> None:
    """Raise ConfigError for a folder that no request and no file of ours can name; `given`: where it was said."""
    if not is_text(folder):
        raise ConfigError(f"{given} {folder}: its name is not UTF-8: use another folder")


class Strict(BaseModel):
    """A frozen section; an unknown key is an error.

    Numbers are finite, whole ones such that a float can hold them, unless a field says how large they may be. A
    boolean is no number, and no number is a boolean.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, defer_build=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: CoreSchema = _guarded(handler(source))
        return schema


def _no_boolean(kind: Any) -> Any:
    def check(value: Any) -> Any:
        if isinstance(value, bool):
            raise PydanticKnownError(kind)
        return value

    return check


def _no_number(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise PydanticKnownError("bool_type")
    return value


def _no_key_twice(value: Any, checked: ValidatorFunctionWrapHandler) -> Any:
    """Keys that differ as they are written may be the same number."""
    made = checked(value)
    if isinstance(value, dict) and len(made) < len(value):
        raise ValueError(f"a key is there twice in {shortened(value)}: leave one out")
    return made


_GUARDS = {"int": _no_boolean("int_type"), "float": _no_boolean("float_type"), "bool": _no_number}
_DATA = ("default", "metadata", "serialization")  # of a schema, which are no schemas


def _guarded(schema: Any) -> Any:
    """A schema of pydantic's whose numbers and booleans are looked at before pydantic turns one into the other."""
    if isinstance(schema, list):
        return [_guarded(part) for part in schema]
    if not isinstance(schema, dict) or _is_guarded(schema):
        return schema
    if schema.get("type") == "dict":
        parts = {key: part if key in _DATA else _guarded(part) for key, part in schema.items()}
        return core_schema.no_info_wrap_validator_function(_no_key_twice, parts)
    guard = _GUARDS.get("bool" if _is_choice_of_booleans(schema) else str(schema.get("type")))
    if guard is None:
        return {key: part if key in _DATA else _guarded(part) for key, part in schema.items()}
    if schema["type"] == "int":
        schema = _bounded(schema)
    return core_schema.no_info_before_validator_function(guard, schema)


def _is_choice_of_booleans(schema: dict[str, Any]) -> bool:
    return schema.get("type") == "literal" and any(isinstance(choice, bool) for choice in schema["expected"])


def _is_guarded(schema: dict[str, Any]) -> bool:
    """A schema may come by several times: that of a section is a part of that of what it is in."""
    function = schema.get("function")
    return isinstance(function, dict) and function.get("function") in (*_GUARDS.values(), _no_key_twice)


def _bounded(schema: dict[str, Any]) -> dict[str, Any]:
    low = {} if schema.keys() & {"ge", "gt"} else {"ge": -LARGEST}
    high = {} if schema.keys() & {"le", "lt"} else {"le": LARGEST}
    return {**schema, **low, **high}


def describe(error: ValidationError, model: type[BaseModel]) -> str:
    """The first problem of a validation error of a model as one line: field, value, remedy."""
    problem = error.errors()[0]
    path, last = _followed(model, problem["loc"])
    field = brief(".".join(path))
    if problem["type"] == "extra_forbidden":
        return f"unknown key {field}{nearest(path[-1], list(last.model_fields) if last else [])}"
    if problem["type"] == "missing":
        return f"{field} is missing: give it a value"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "union_tag_invalid":
        context = problem["ctx"]
        return f"{field}.kind: unknown {shortened(context['tag'])}: known are {context['expected_tags']}"
    if problem["type"] in ("model_type", "model_attributes_type"):
        return f"{field}: input should be a valid dictionary, not {shortened(problem['input'])}"
    if problem["type"] == "value_error":
        return f"{field}: {message}" if field else message
    where = f"{field}: " if field else ""
    message = message.partition(" after validation")[0]
    for theirs, ours in _WORDS.items():
        message = message.replace(theirs, ours)
    return f"{where}{message[0].lower()}{message[1:]}, not {shortened(problem['input'])}"


def shortened(value: Any, most: int = 80) -> str:
    """A value as an error line shows it.

    >>> shortened("a" * 9, most=8)
    "'aaaa..."
    """
    text = repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def brief(name: str, most: int = 80) -> str:
    """A name as an error line shows it.

    >>> brief("a" * 9, most=8)
    'aaaaa...'
    """
    return name if len(name) <= most else f"{name[: most - 3]}..."


def _followed(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[list[str], type[BaseModel] | None]:
    """A location as users write it, without the names that pydantic gives to choices; and the model that it ends in."""
    path: list[str] = []
    at: Any = model
    last: type[BaseModel] | None = model
    for part in location:
        if part == "[key]":
            continue
        choices = [_plain(choice) for choice in _choices(at)]
        models = [choice for choice in choices if isinstance(choice, type) and issubclass(choice, BaseModel)]
        tagged = [choice for choice in _choices(at) if any(getattr(tag, "tag", None) == part for tag in _tags(choice))]
        tagged = tagged or [choice for choice in models if part in _kinds(choice)]
        if tagged:
            at = last = _plain(tagged[0])
        elif (owner := next((choice for choice in models if part in choice.model_fields), None)) is not None:
            path.append(str(part))
            at = owner.model_fields[str(part)].annotation
            last = section_of(at)
        elif (inner := _inside(choices, part)) is not None:
            path.append(str(part))
            at, last = inner, section_of(inner)
        elif models or not path or not isinstance(part, str):
            path.append(str(part))  # a key that nobody knows
    return path, last


def _inside(choices: Sequence[Any], part: int | str) -> Any:
    """The type of what is in a mapping or, for a number, in a list; None if nothing is in it."""
    for choice in choices:
        if get_origin(choice) is dict or (get_origin(choice) in (list, tuple) and isinstance(part, int)):
            return [kind for kind in get_args(choice) if kind is not Ellipsis][-1]
    return None


def _choices(annotation: Any) -> tuple[Any, ...]:
    """The members of a union, or what else it is."""
    plain = _plain(annotation)
    return get_args(plain) if get_origin(plain) in (Union, UnionType) else (annotation,)


def _plain(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _tags(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()


def _kinds(model: type[BaseModel]) -> tuple[Any, ...]:
    """By what a model is told from others, if it is one of several."""
    field = model.model_fields.get("kind")
    return () if field is None else get_args(field.annotation)


def nearest(word: str, known: list[str]) -> str:
    """A hint that ends an error line: the nearest known name, and the list."""
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    hint = f": did you mean {close[0]}?" if close else ":"
    return f"{hint} known are {', '.join(sorted(known))}"


def section_of(annotation: Any, kind: str | None = None) -> type[BaseModel] | None:
    """The model of a field that is a section, which may be left out; None for other fields.

    Of several models that of this `kind`, or else the first.
    """
    plain = [_plain(choice) for choice in _choices(annotation)]
    models = [choice for choice in plain if isinstance(choice, type) and issubclass(choice, BaseModel)]
    return next((model for model in models if kind in _kinds(model)), models[0] if models else None)


def by_kind(default: str) -> Discriminator:
    """Tells models apart by their `kind`; what does not say it is of the default one."""

    def kind_of(data: Any) -> str:
        found = data.get("kind", default) if isinstance(data, dict) else getattr(data, "kind", default)
        return str(found)

    return Discriminator(kind_of)


def flat(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested keys as dotted ones.

    >>> flat({"a": {"b": 1}, "c": 2})
    {'a.b': 1, 'c': 2}
    """
    result: dict[str, Any] = {}
    for key, value in data.items():
        result |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return result
