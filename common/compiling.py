"""Compiling functions with numba, for `common.kernel`, which alone imports this: importing numba takes a second.

Numba keeps compiled code on disk, and makes it anew when the function's own file has changed; it does not see that a
constant or a function from another file went into it. Here every file of ours that the file imports counts, directly or
through others. And of processes that start at the same time one compiles a function; the others wait, then load it.
"""

import fcntl
import inspect
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numba
from numba.core import caching, event, types

from railctl.common.compile_signs import compiling
from railctl.common.sources import digest


class KernelCache(caching.FunctionCache):
    """The compiled forms of one function on disk.

    Numba asks for a form, and hands it in when it has compiled what was not there. In between this process holds the
    function's lock. A function waits for those that it calls, never the other way round, so nobody waits for ever.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        self._name = function.__name__
        self._compiles: list[ExitStack] = []  # one inside the other if the function calls itself
        folder, base = Path(self.cache_path), self._impl.filename_base
        self._lock_file = folder / f"{base}.lock"
        source = Path(inspect.getfile(function)).resolve()
        stamp = digest(source, memo=folder / f"{source.stem}.sources.json")
        self._cache_file = caching.IndexDataCacheFile(self.cache_path, base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled form for a signature; None: there is none, and it is this process's to make it."""
        found = super().load_overload(sig, target_context)
        if found is None:
            with ExitStack() as begun:
                begun.enter_context(compiling(self._name))
                if not self._compiles:
                    lock(begun.enter_context(self._lock_file.open("w")))
                    found = super().load_overload(sig, target_context)
                if found is None:
                    self._compiles.append(begun.pop_all())
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Take in what has been compiled."""
        try:
            super().save_overload(sig, data)
        finally:
            self.end_compiling()

    def end_compiling(self) -> None:
        """Let others go on."""
        self._compiles.pop().close()


def lock(file: IO[str]) -> None:
    """Wait until no other process holds the file's lock; it lasts until the file is closed, or this process ends."""
    fcntl.flock(file, fcntl.LOCK_EX)


class _Failures(event.Listener):
    """Hears of functions that cannot be compiled, which are handed in nowhere."""

    def on_start(self, event: Any) -> None: ...

    def on_end(self, event: Any) -> None:
        cache = event.data["dispatcher"]._cache  # noqa: SLF001  (numba has no other way to it)
        failed = event._exc_details is not None  # noqa: SLF001  (numba 0.68's `is_failed` says the opposite)
        if failed and isinstance(cache, KernelCache):
            cache.end_compiling()


event.register("numba:compile", _Failures())


def compiled(function: Callable[..., object], *, counts_references: bool) -> Any:
    """What numba makes of a function."""
    njit: Any = numba.njit  # whose types leave out the option that turns the counting off
    dispatcher = njit(error_model="numpy", _nrt=counts_references)(function)
    dispatcher._cache = KernelCache(function)  # noqa: SLF001  (as `enable_caching` does with numba's own)
    if hasattr(dispatcher, "get_call_template"):  # unless numba is told to compile nothing
        dispatcher.get_call_template = _called_with_few_types(dispatcher.get_call_template)
    return dispatcher


def _called_with_few_types(template: Callable[..., Any]) -> Callable[..., Any]:
    """What numba asks when one compiled function calls another, with types for `args` and `kws`.

    It otherwise compiles a function, and all that this calls, once for every constant and size of integers it is given.
    """

    def called(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        return template(tuple(map(general, args)), {name: general(arg) for name, arg in kws.items()})

    return called


def general(kind: Any) -> Any:
    """The type that a value of this type is passed as: integers have 64 bits."""
    kind = types.unliteral(kind)
    return types.int64 if isinstance(kind, types.Integer) and kind != types.uint64 else kind
