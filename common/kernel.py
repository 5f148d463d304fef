"""The one way in which functions are compiled: when they are first called, or compiled into one that is.

So whoever only reads what else is in a module need not wait the second that importing numba takes.
"""

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., object])


class Kernel:
    """A function that stands for its compiled form; `.py_func` is the original."""

    def __init__(self, function: Callable[..., object], *, counts_references: bool) -> None:
        self.py_func = function
        self._counts_references = counts_references
        update_wrapper(self, function)

    @cached_property
    def compiled(self) -> Any:
        """What numba makes of it."""
        from railctl.common.compiling import compiled  # noqa: PLC0415  (see the module)

        return compiled(self.py_func, counts_references=self._counts_references)

    @property
    def _numba_type_(self) -> Any:
        """How numba sees it where another function calls it."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        return self.compiled(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.compiled, name)


def kernel(function: Function) -> Function:
    """Compile `function`, once a machine; exact arithmetic (no fastmath), one thread; `.py_func` is the original."""
    return cast("Function", Kernel(function, counts_references=True))


def bare_kernel(function: Function) -> Function:
    """As `kernel`, for functions that make no arrays and keep none: who calls them holds what they work on.

    Numba otherwise counts a reference for every array of every call, which takes longer than most kernels do.
    """
    return cast("Function", Kernel(function, counts_references=False))
