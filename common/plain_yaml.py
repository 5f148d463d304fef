"""YAML as plain data and nothing else; text that is mistaken, hostile or enormous is refused while it is read.

Texts, numbers, booleans, null, lists and mappings. No tags, no dates (they are texts), no key that comes twice, no text
that cannot be printed, no integer beyond 64 bits, no number in base 8 or 60 that looks like another. Aliases count as
often as what they stand for: a few lines of them can stand for more than any memory holds.
"""

import re
from typing import Any

import yaml
from yaml.constructor import ConstructorError
from yaml.error import MarkedYAMLError
from yaml.nodes import CollectionNode, MappingNode, Node, ScalarNode

from railctl.common.strict import shortened

DEEPEST = 32  # lists and mappings within each other
MOST_VALUES = 100_000  # of a text, its aliases written out
LONGEST = 4096  # characters of a value, as many as a path may have
LONGEST_NUMBER = 64  # characters
LONGEST_COMPLAINT = 300  # characters
MERGE, TIMESTAMP = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:timestamp"
NUMBERS = {"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"}
SURPRISING = re.compile(r"[-+]?0[0-9_]+|.*:.*")  # 010 is 8 to YAML 1.1, and 1:30 is 90


class NotPlainYamlError(ValueError):
    """A text is not YAML, or not plain: one short line that says why, and where."""


class _Reader(yaml.SafeLoader):
    """The library's reader, stricter."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._measured: dict[Node, tuple[int, int]] = {}  # values in it, and how deep they are within each other

    def compose_node(self, parent: Node | None, index: Any) -> Node:
        """As the library does, but only what is plain and of bounded depth and size."""
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if getattr(event, "tag", None) is not None:
            raise _refusal(f"a tag ({event.tag}): leave it out", event)
        if self._depth >= DEEPEST:
            raise _refusal(f"more than {DEEPEST} lists and mappings in each other", event)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        assert node is not None  # noqa: S101  (there is one for every event)
        if node not in self._measured:
            if isinstance(event, yaml.AliasEvent):
                raise _refusal(f"*{shortened(event.anchor)} is a part of itself", event)
            self._measured[node] = self._measure(node)
        return node

    def _measure(self, node: Node) -> tuple[int, int]:
        if isinstance(node, ScalarNode):
            _check_scalar(node)
        parts = _parts(node)
        values = 1 + sum(self._measured[part][0] for part in parts)
        depth = 1 + max((self._measured[part][1] for part in parts), default=0)
        if values > MOST_VALUES or depth > DEEPEST:
            most = f"{MOST_VALUES} values, {DEEPEST} in each other, are the most"
            raise _refusal(f"holds too much, its aliases written out: {most}", node)
        return values, depth

    def construct_mapping(self, node: MappingNode, deep: bool = False) -> dict[Any, Any]:
        """As the library does, but every key is a plain value and comes once; those of `<<` may be overwritten."""
        seen = set()
        for key, _value in node.value:
            if not isinstance(key, ScalarNode):
                raise _refusal("a key that is a list or a mapping", key)
            name = key.tag if key.tag == MERGE else self.construct_object(key)
            if name in seen:
                raise _refusal(f"the key {shortened(name)} is there twice: leave one out", key)
            seen.add(name)
        return super().construct_mapping(node, deep)


# Dates are of no use here, and 1e-3 is a number for everybody but YAML 1.1.
_Reader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in known if tag != TIMESTAMP]
    for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_POWERS = "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
_Reader.add_implicit_resolver(*_POWERS)


class _Writer(yaml.SafeDumper):
    """The library's writer, which puts a text into quotes if the reader would take it for a number."""


_Writer.add_implicit_resolver(*_POWERS)


def dump_yaml(data: Any) -> str:
    """A text that `parse_yaml` reads as these data, in their order."""
    text: str = yaml.dump(data, Dumper=_Writer, sort_keys=False)
    return text


def parse_yaml(text: str) -> Any:
    """What a text says.

    Raises:
        NotPlainYamlError: it is not YAML, or not plain.
    """
    try:
        reader = _Reader(text)
        try:
            data = reader.get_single_data()
        finally:
            reader.dispose()
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # a number that is none is a ValueError
        raise NotPlainYamlError(_complaint(error)) from None
    return data


def _complaint(error: Exception) -> str:
    text, place = str(error), ""
    if isinstance(error, MarkedYAMLError):
        text = ": ".join(part for part in (error.context, error.problem) if part)
        mark = error.problem_mark or error.context_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
    line = " ".join(text.split())
    return (line if len(line) <= LONGEST_COMPLAINT else f"{line[:LONGEST_COMPLAINT]}...") + place


def _parts(node: Node) -> list[Node]:
    if isinstance(node, MappingNode):
        return [part for pair in node.value for part in pair]
    return node.value if isinstance(node, CollectionNode) else []


def _check_scalar(node: ScalarNode) -> None:
    text = node.value
    if len(text) > (LONGEST_NUMBER if node.tag in NUMBERS else LONGEST):
        raise _refusal(f"{shortened(text, 40)} is too long", node)
    if not text.isprintable():
        raise _refusal(f"{shortened(text, 40)} has line ends or other characters that cannot be printed", node)
    if node.tag in NUMBERS and SURPRISING.fullmatch(text):
        raise _refusal(f"{shortened(text, 40)} is in base 8 or 60 to YAML: write it in base 10, or in quotes", node)


def _refusal(problem: str, where: Any) -> ConstructorError:
    return ConstructorError(None, None, problem, where.start_mark)


def _whole(reader: _Reader, node: ScalarNode) -> int:
    number: int = reader.construct_yaml_int(node)
    if not -(2**63) <= number < 2**63:
        raise _refusal(f"{shortened(node.value, 40)} is beyond 64 bits", node)
    return number


_Reader.add_constructor("tag:yaml.org,2002:int", _whole)
