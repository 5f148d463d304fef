"""Compiling functions with numba, for `common.kernel`, which alone imports this: importing numba takes a second.

Numba keeps compiled code on disk, and makes it anew when the function's own file has changed; it does not see that a
constant or a function from another file went into it. Here every file of ours that the file imports counts, directly or
through others.
"""

import ast
import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

ROOT = Path(__file__).resolve().parents[1]


@cache
def _imports(path: Path) -> tuple[Path, ...]:
    """The files of ours that a file imports, wherever in it."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(file for name in dict.fromkeys(names) for file in _files(name, beside=path.parent))


def _files(module: str, beside: Path) -> Iterator[Path]:
    """Where a module may lie: below the root, or beside who imports it."""
    for folder in dict.fromkeys((ROOT, beside)):
        place = folder.joinpath(*module.split("."))
        yield from (file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file())


@cache
def _digest(path: Path) -> bytes:
    """Of a file, and of all that it imports of ours."""
    found = {path}
    waiting = [path]
    while waiting:
        fresh = set(_imports(waiting.pop())) - found
        found |= fresh
        waiting += fresh
    state = hashlib.blake2b(digest_size=16)
    for file in sorted(found):
        state.update(f"{file}/{file.stat().st_size}/".encode())
        state.update(file.read_bytes())
    return state.digest()


class _StampedByImports:
    """The part of a locator that says when compiled code is stale."""

    _py_file: str

    def get_source_stamp(self) -> bytes:
        return _digest(Path(self._py_file).resolve())


class GivenLocator(_StampedByImports, caching.UserProvidedCacheLocator):
    """Where NUMBA_CACHE_DIR says."""


class InTreeLocator(_StampedByImports, caching.InTreeCacheLocator):
    """Beside the source."""


class UserWideLocator(_StampedByImports, caching.UserWideCacheLocator):
    """In the user's cache, where sources cannot be written beside."""


_LOCATORS = ",".join(f"{__name__}.{locator.__name__}" for locator in (GivenLocator, InTreeLocator, UserWideLocator))


def compiled(function: Callable[..., object], *, counts_references: bool) -> Any:
    """What numba makes of a function."""
    config: Any = numba.config
    njit: Any = numba.njit  # whose types leave out the option that turns the counting off
    before, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, _LOCATORS
    try:
        return njit(cache=True, error_model="numpy", _nrt=counts_references)(function)
    finally:
        config.CACHE_LOCATOR_CLASSES = before
