"""numpy's random numbers in compiled code: those of `Generator(Philox(key=key))`, to the bit.

A generator of numpy's own asks the system for randomness before it takes on its key, which costs more than a batch's
draws. Philox4x64-10 is of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011: four words of a
stream from a counter and a key. Whole numbers below a limit are drawn as numpy does, after Lemire, "Fast random integer
generation in an interval", 2019, from halves of words, the lower one first.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel

_Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]

ROUNDS = 10
FACTORS = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
STEPS = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
LOW, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
ZERO, ONE = np.uint64(0), np.uint64(1)
BEHIND_DOUBLE = np.uint64(11)  # bits of a word that a double in [0, 1) has no room for


@bare_kernel
def high(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper word of a product."""
    a0, a1, b0, b1 = a & LOW, a >> HALF, b & LOW, b >> HALF
    middle = a1 * b0 + (a0 * b0 >> HALF)
    return a1 * b1 + (middle >> HALF) + (a0 * b1 + (middle & LOW) >> HALF)


@bare_kernel
def words(key: np.uint64, counter: np.uint64) -> _Words:
    """The four words of a key's stream at a counter, the first of which is 1."""
    c0, c1, c2, c3 = counter, ZERO, ZERO, ZERO
    k0, k1 = key, ZERO
    for _ in range(ROUNDS):
        c0, c1, c2, c3 = (
            high(FACTORS[1], c2) ^ c1 ^ k0,
            FACTORS[1] * c2,
            high(FACTORS[0], c0) ^ c3 ^ k1,
            FACTORS[0] * c0,
        )
        k0, k1 = k0 + STEPS[0], k1 + STEPS[1]
    return c0, c1, c2, c3


@bare_kernel
def draw_below(key: np.uint64, limit: int, out: NDArray[np.int64]) -> None:
    """Fill `out` as `Generator.integers(limit)` does, for a limit of 1 to 2^32 - 1."""
    below = np.uint64(limit)
    least = ((ONE << HALF) - below) % below  # of what is left of a product: fewer would favour some numbers
    counter, half, four = ZERO, 8, (ZERO, ZERO, ZERO, ZERO)
    item = 0
    while item < len(out):
        if half == 8:
            counter, half = counter + ONE, 0
            four = words(key, counter)
        word = four[half >> 1]
        product = (word >> HALF if half & 1 else word & LOW) * below
        half += 1
        if product & LOW >= least:
            out[item] = np.int64(product >> HALF)
            item += 1


@bare_kernel
def draw_uniform(key: np.uint64, out: NDArray[np.float64]) -> None:
    """Fill `out` as `Generator.random` does: multiples of 2^-53 in [0, 1)."""
    four = (ZERO, ZERO, ZERO, ZERO)
    for item in range(len(out)):
        if item % 4 == 0:
            four = words(key, np.uint64(item // 4 + 1))
        out[item] = np.float64(four[item % 4] >> BEHIND_DOUBLE) * 2.0**-53
