"""Curves in an .npz file: a project's own or other people's.

Arrays: `returns` (floats) [A, K, R, N], or in their place `returns_int` (integers) and `scale`, whose quotient they
are; `block` (episodes an evaluation point) and `n_zones`; names `algorithms` [A] and `levels` [K], or none.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.analysis.reliability.curves import Curves, CurvesError, Floats
from railctl.common.levels.files import LevelFileError, opened
from railctl.common.strict import nearest

Arrays = Mapping[str, NDArray[Any]]

SCALED, SETTINGS, NAMES = ("returns_int", "scale"), ("block", "n_zones"), ("algorithms", "levels")


def load(path: Path) -> Curves:
    """Read a file of curves.

    Raises:
        CurvesError: it cannot be read, or something in it is not as it should be.
    """
    try:
        with opened(path) as stored:
            arrays = dict(stored)
    except LevelFileError as error:
        raise CurvesError(str(error)) from None
    try:
        return _curves(arrays)
    except CurvesError as error:
        raise CurvesError(f"{path}: {error}") from None


def _curves(arrays: Arrays) -> Curves:
    needed = (("returns",) if "returns" in arrays else SCALED) + SETTINGS
    for name in needed:
        if name not in arrays:
            raise CurvesError(f"the array {name} is missing: give {', '.join(needed)}, and names if you like")
    for name in arrays:
        if name not in needed + NAMES:
            raise CurvesError(f"unknown array {name}{nearest(name, [*needed, *NAMES])}")
    return Curves(
        returns=_floats(arrays["returns"]) if "returns" in arrays else _scaled(arrays["returns_int"], arrays["scale"]),
        block=_whole_number("block", arrays["block"]),
        zones=_whole_number("n_zones", arrays["n_zones"]),
        algorithms=_names("algorithms", arrays),
        levels=_names("levels", arrays),
    )


def _floats(returns: NDArray[Any]) -> Floats:
    if not np.issubdtype(returns.dtype, np.floating):
        raise CurvesError(f"returns holds {returns.dtype}: use floats, or integers in returns_int with a scale")
    return returns.astype(np.float64)


def _scaled(returns: NDArray[Any], scale: NDArray[Any]) -> Floats:
    if not np.issubdtype(returns.dtype, np.integer):
        raise CurvesError(f"returns_int holds {returns.dtype}: use integers, or floats in an array returns")
    number = scale.dtype.kind in "iuf" and scale.ndim == 0
    if not number or not np.isfinite(scale) or scale <= 0:
        raise CurvesError(f"scale is {_shown(scale)}: use one number above 0")
    wrong = np.argwhere((returns > 0) | (returns < -float(scale)))
    if len(wrong):
        place = tuple(wrong[0])
        at = ", ".join(map(str, place))
        raise CurvesError(
            f"returns_int[{at}] is {returns[place]}: divided by scale {scale} it must lie in [-1, 0], as returns do"
        )
    return returns / float(scale)


def _whole_number(name: str, array: NDArray[Any]) -> int:
    if array.ndim or not np.issubdtype(array.dtype, np.integer):
        raise CurvesError(f"{name} is {_shown(array)}: use one whole number")
    return int(array)


def _names(name: str, arrays: Arrays) -> tuple[str, ...]:
    if name not in arrays:
        return ()
    names = arrays[name]
    if names.ndim != 1 or names.dtype.kind != "U":
        raise CurvesError(f"{name} is {_shown(names)}: use a list of texts")
    return tuple(names.tolist())


def _shown(array: NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}" if array.ndim else f"{array.item()!r}"
