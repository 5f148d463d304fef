"""The one way in which this package compiles functions."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile `function`, once a machine; exact arithmetic (no fastmath), one thread; `.py_func` is the original."""
    return cast("Function", numba.njit(cache=True, error_model="numpy")(function))
