"""Files of demonstrations: whole episodes that a policy played, as they travel on the wire.

A line of JSON, which any version can read, says what is in a file and in which schema. Then come the episodes, for each
the length of its message in 8 bytes, little-endian, and the message (`common.wire.codec`), and at the end a digest of
all that. Reading is strict: a file is what its first line says, to the last bit, or it is refused.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Final, Literal

from pydantic import Field, ValidationError

from railctl.common.bounded import parse_json
from railctl.common.records.base import Digest, Text
from railctl.common.records.course import Course
from railctl.common.strict import Strict, describe
from railctl.common.wire.codec import MAX_MESSAGE_BYTES, SCHEMA_VERSION, Refused, decode, encode, encoding_of
from railctl.common.world import WorldSpec

FORMAT: Final = "railctl demonstrations"
MOST_LINE_BYTES = 65_536
LENGTH_BYTES = 8
DIGEST_BYTES = 16


class DemonstrationsError(Exception):
    """A file of demonstrations cannot be used: one line that names it."""


class Heading(Strict):
    """The first line of a file.

    Attributes:
        schema_version: of the messages.
        world: `digest_of` the world that the episodes were played in.
        n_features: F, what trains saw there.
        policy: who played, in words.
        episodes: how many there are.
    """

    format: Literal["railctl demonstrations"] = FORMAT
    schema_version: int
    world: Digest
    n_features: int = Field(ge=1)
    policy: Text
    episodes: int = Field(ge=1)


def digest_of(world: WorldSpec) -> str:
    """What two worlds share that are the same: levels, observation, decisions, rewards, interlocking and patience."""
    text = json.dumps(world.model_dump(mode="json"), sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def digest_of_file(path: Path) -> str:
    """What two files share that are the same.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def write_demonstrations(path: Path, world: WorldSpec, policy: str, episodes: int, courses: Iterable[Course]) -> None:
    """Write as many episodes as are said, as they come; nobody ever sees a part of the file.

    Raises:
        OSError: it cannot be written, or is there already.
        ValueError: there are more or fewer episodes.
    """
    heading = Heading(
        schema_version=SCHEMA_VERSION,
        world=digest_of(world),
        n_features=world.n_features,
        policy=policy,
        episodes=episodes,
    )
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as file:
            whole = _Digested(file)
            whole.write(heading.model_dump_json().encode() + b"\n")
            written = 0
            for course in courses:
                body = encode(course)
                whole.write(len(body).to_bytes(LENGTH_BYTES, "little") + body)
                written += 1
            file.write(whole.digest.digest())
        if written != episodes:
            raise ValueError(f"{path}: {written} episodes were played, {episodes} announced")
        path.hardlink_to(temporary)  # which a file that is there by now forbids
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None  # nobody knows of the other one
    finally:
        temporary.unlink(missing_ok=True)


class _Digested:
    """Keeps a digest of all that goes through it, into a file or out of it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.digest = hashlib.blake2b(digest_size=DIGEST_BYTES)

    def write(self, part: bytes) -> None:
        self._file.write(part)
        self.digest.update(part)

    def read(self, size: int) -> bytes:
        return self._noted(self._file.read(size))

    def readline(self, most: int) -> bytes:
        return self._noted(self._file.readline(most))

    def _noted(self, part: bytes) -> bytes:
        self.digest.update(part)
        return part


def read_demonstrations(path: Path) -> tuple[Heading, Iterator[Course]]:
    """What a file holds; its episodes are read as they are asked for.

    Raises:
        DemonstrationsError: the first line is not one; the episodes raise it as well, for what is wrong with them.
    """
    with _opened(path) as file:
        heading = _heading(path, file.readline(MOST_LINE_BYTES))
    return heading, _courses(path, heading)


def _opened(path: Path) -> BinaryIO:
    try:
        if path.exists() and not path.is_file():
            raise DemonstrationsError(f"{path}: is no file: give one of railctl demonstrate")  # a pipe would wait
        return path.open("rb")
    except OSError as error:
        raise DemonstrationsError(f"{path}: {error.strerror}: give a file of railctl demonstrate") from None


def _heading(path: Path, line: bytes) -> Heading:
    try:
        plain = parse_json(line)
    except ValueError:
        plain = None
    if not line.endswith(b"\n") or not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise DemonstrationsError(f"{path}: no demonstrations: give a file of railctl demonstrate")
    if plain.get("schema_version") != SCHEMA_VERSION:
        version = repr(plain.get("schema_version"))
        raise DemonstrationsError(
            f"{path}: its schema is {version:.20}, this version's {SCHEMA_VERSION}: make it anew with "
            "railctl demonstrate"
        )
    try:
        return Heading.model_validate(plain)
    except ValidationError as error:
        raise DemonstrationsError(f"{path}: first line: {describe(error, Heading)}") from None


def _courses(path: Path, heading: Heading) -> Iterator[Course]:
    with _opened(path) as file:
        whole = _Digested(file)
        whole.readline(MOST_LINE_BYTES)
        for number in range(heading.episodes):
            try:
                course = _course(whole)
                check_whole(course, heading.n_features)
            except (Refused, ValueError) as error:
                raise DemonstrationsError(
                    f"{path}: episode {number}: {error}: make the file anew with railctl demonstrate"
                ) from None
            yield course
        if file.read(DIGEST_BYTES + 1) != whole.digest.digest():
            raise DemonstrationsError(f"{path}: damaged, or holds more episodes than it says: make the file anew")


def _course(file: _Digested) -> Course:
    size = file.read(LENGTH_BYTES)
    length = int.from_bytes(size, "little")
    if len(size) == LENGTH_BYTES and length > MAX_MESSAGE_BYTES:
        raise ValueError(f"{length} bytes exceed the limit of {MAX_MESSAGE_BYTES}")
    body = file.read(length)
    if len(size) < LENGTH_BYTES or len(body) < length:
        raise ValueError("the file ends in it")
    return decode(Course, encoding_of(Course), body)


def check_whole(course: Course, n_features: int) -> None:
    """Raises ValueError for what is no whole episode in which trains saw so many features."""
    if course.first_step or not course.over:
        raise ValueError("is not whole")
    seen = course.decisions.observations.shape[1]
    if seen != n_features:
        raise ValueError(f"has {seen} features, not {n_features}")
