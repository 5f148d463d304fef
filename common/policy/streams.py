"""The streams of `common.seeding`, compiled: the same bits for the same key and counter.

Keys and counters are uint64; in compiled code a signed number beside an unsigned one would turn both into floats, so
callers convert first.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import log
from railctl.common.seeding import GAMMA

_GAMMA = np.uint64(GAMMA)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_ONE, _11, _27, _30, _31 = np.uint64(1), np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)
_TO_UNIT = 2.0**-53


@bare_kernel
def bits(key: np.uint64, counter: np.uint64) -> np.uint64:
    """Draw `counter` of stream `key`: 64 random bits, as `seeding.bits`."""
    z = key + (counter + _ONE) * _GAMMA
    z = (z ^ (z >> _30)) * _MIX_1
    z = (z ^ (z >> _27)) * _MIX_2
    return z ^ (z >> _31)


@bare_kernel
def uniform(key: np.uint64, counter: np.uint64) -> float:
    """Draw `counter` of stream `key` as a float64 in [0, 1), as `seeding.uniform`."""
    return float(bits(key, counter) >> _11) * _TO_UNIT


@bare_kernel
def normals(key: np.uint64, out: NDArray[np.float64]) -> None:
    """Fill `out` [n] with the standard normal variates of stream `key`.

    Marsaglia & Bray, "A convenient method for generating normal variables" (1964): the polar method, which needs
    no more than a logarithm and a square root.
    """
    counter = np.uint64(0)
    for place in range(0, len(out), 2):
        square = 2.0
        while square >= 1.0 or square == 0.0:
            u = 2.0 * uniform(key, counter) - 1.0
            v = 2.0 * uniform(key, counter + _ONE) - 1.0
            counter += _ONE + _ONE
            square = u * u + v * v
        scale = np.sqrt(-2.0 * log(square) / square)
        out[place] = u * scale
        if place + 1 < len(out):
            out[place + 1] = v * scale
