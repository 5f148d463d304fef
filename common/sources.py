"""A digest of a source file and of all that it imports of ours, directly or through others.

Parsing every source takes longer than loading the machine code that was made of them, so the digest is kept in a memo,
together with what the file system says of each file and folder that it came from. As long as that is the same, so is
the digest: files that change in any way get another size, inode or time, and files that come or go change their folder.
"""

import ast
import hashlib
import json
import os
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).absolute().parents[1]  # beside it may lie all that is installed, which is not ours
SETTLED_S = 2.0  # what changed just before may change again within one tick of the file system's clock

Stamp = list[int]


def digest(source: Path, memo: Path) -> bytes:
    """Of a source file and all that it imports of ours, 16 bytes; `memo` is where it is kept, if it can be."""
    kept = _kept(memo)
    if kept is not None:
        return kept
    found, folders = _reach(source)
    # Stamps come first: what changes between them and the reading is found to have changed.
    stamps = {str(path): _stamp(str(path)) for path in (*found, *folders)}
    state = hashlib.blake2b(digest_size=16)
    for file in found:
        state.update(f"{file}/{file.stat().st_size}/".encode())
        state.update(file.read_bytes())
    newest = max(max(stamp[:2]) for stamp in stamps.values() if stamp is not None)
    if time.time_ns() - newest > SETTLED_S * 1e9:
        _keep(memo, {"digest": state.hexdigest(), "stamps": stamps})
    return state.digest()


def _kept(memo: Path) -> bytes | None:
    """The digest that a memo holds, or None if it has none, or anything is not as it was."""
    try:
        document = json.loads(memo.read_bytes())
        if any(_stamp(path) != stamp for path, stamp in document["stamps"].items()):
            return None
        return bytes.fromhex(document["digest"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _keep(memo: Path, document: dict[str, object]) -> None:
    temporary = memo.with_name(f".{memo.name}.{os.getpid()}")
    try:
        temporary.write_text(json.dumps(document))
        temporary.replace(memo)
    except OSError:
        temporary.unlink(missing_ok=True)  # the next process parses again


@cache
def _stamp(path: str) -> Stamp | None:
    """What the file system says of a file or folder: times of change in ns, inode, size; None: it is not there."""
    try:
        found = Path(path).stat()
    except OSError:
        return None
    return [found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size]


def _reach(source: Path) -> tuple[list[Path], set[Path]]:
    """The source and all that it imports of ours, in order, and the folders where they were looked for."""
    found = {source}
    waiting = [source]
    folders: set[Path] = set()
    while waiting:
        names, beside = _imports(waiting[-1]), waiting.pop().parent
        for name in names:
            for place in _places(name, beside):
                folders.update(_watched(place))
                for file in (place.with_suffix(".py"), place / "__init__.py"):
                    if file.is_file() and file not in found:
                        found.add(file)
                        waiting.append(file)
    return sorted(found), folders


def _watched(place: Path) -> Iterator[Path]:
    """The folders of which one changes when a module comes to be at a place where there was none."""
    if place.is_dir():
        yield place
    yield next(folder for folder in place.parents if folder.is_dir())


@cache
def _imports(path: Path) -> tuple[str, ...]:
    """The names of modules that a file imports, wherever in it."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(names))


def _places(module: str, beside: Path) -> Iterator[Path]:
    """Where a module of ours may lie: in the package, or beside who imports it."""
    first, *rest = module.split(".")
    if first != PACKAGE.name:
        yield beside.joinpath(first, *rest)
    elif rest:
        yield PACKAGE.joinpath(*rest)
