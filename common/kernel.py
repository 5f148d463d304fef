"""The one way in which functions are compiled.

Numba keeps compiled code on disk, and makes it anew when the function's own file has changed; it does not see that a
constant or a function from another file went into it. Here everything under the same package of `common` counts
(elsewhere, everything beside the file).
"""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import caching

HERE = Path(__file__).parent

Function = TypeVar("Function", bound=Callable[..., object])


@cache
def _digest(package: Path) -> bytes:
    """Of all sources in `package`, and of this one."""
    state = hashlib.blake2b(digest_size=16)
    for path in [Path(__file__), *sorted(package.rglob("*.py"))]:
        state.update(f"{path}/{path.stat().st_size}/".encode())
        state.update(path.read_bytes())
    return state.digest()


class _StampedByPackage:
    """The part of a locator that says when compiled code is stale."""

    _py_file: str

    def get_source_stamp(self) -> bytes:
        path = Path(self._py_file).resolve()
        if HERE.resolve() not in path.parents:
            return _digest(path.parent)
        return _digest(HERE / path.relative_to(HERE.resolve()).parts[0])


class GivenLocator(_StampedByPackage, caching.UserProvidedCacheLocator):
    """Where NUMBA_CACHE_DIR says."""


class InTreeLocator(_StampedByPackage, caching.InTreeCacheLocator):
    """Beside the source."""


class UserWideLocator(_StampedByPackage, caching.UserWideCacheLocator):
    """In the user's cache, where sources cannot be written beside."""


_LOCATORS = ",".join(f"{__name__}.{locator.__name__}" for locator in (GivenLocator, InTreeLocator, UserWideLocator))


def kernel(function: Function) -> Function:
    """Compile `function`, once a machine; exact arithmetic (no fastmath), one thread; `.py_func` is the original."""
    return _compiled(function, counts_references=True)


def bare_kernel(function: Function) -> Function:
    """As `kernel`, for functions that make no arrays and keep none: who calls them holds what they work on.

    Numba otherwise counts a reference for every array of every call, which takes longer than most kernels do.
    """
    return _compiled(function, counts_references=False)


def _compiled(function: Function, *, counts_references: bool) -> Function:
    config: Any = numba.config
    njit: Any = numba.njit  # whose types leave out the option that turns the counting off
    before, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, _LOCATORS
    try:
        return cast("Function", njit(cache=True, error_model="numpy", _nrt=counts_references)(function))
    finally:
        config.CACHE_LOCATOR_CLASSES = before
