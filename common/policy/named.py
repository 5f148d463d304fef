"""Parameters and what else training changes, as arrays of float32 by name."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from railctl.common.policy.flat import Arrays


def copies(arrays: Arrays) -> dict[str, NDArray[np.float32]]:
    """A copy of each, which lies in memory as the array does."""
    return {name: array.copy(order="K") for name, array in arrays.items()}


def overwrite(own: Arrays, arrays: Arrays) -> None:
    """Overwrite each of `own` in place with the array of its name; raises as `check_fit`."""
    check_fit({name: array.shape for name, array in own.items()}, arrays)
    for name, array in own.items():
        array[...] = arrays[name]


def check_fit(shapes: Mapping[str, tuple[int, ...]], arrays: Arrays) -> None:
    """Compare arrays with what they should be.

    Raises:
        ValueError: naming the first tensor that is missing, unknown, or of another dtype or shape.
    """
    for name in (*shapes, *arrays):
        if name not in arrays:
            raise ValueError(f"tensor {name} is missing: this state is of another network or algorithm")
        if name not in shapes:
            raise ValueError(f"tensor {name} is unknown here: this state is of another network or algorithm")
        want, got = shapes[name], arrays[name]
        if got.dtype != np.float32:
            raise ValueError(f"tensor {name} has dtype {got.dtype}, not float32")
        if got.shape != want:
            raise ValueError(f"tensor {name} has shape {got.shape}, not {want}")
