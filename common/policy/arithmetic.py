"""exp, log, tanh, sigmoid and powers in additions, multiplications, divisions: the same bits on every x86-64 processor.

A system's own functions differ between versions of its library in the last bit, and a policy's choice may hang on it.
Here everything is IEEE arithmetic in float64 in a fixed order, so it cannot differ, and its error (below 1e-12
relative) vanishes when the result is rounded to float32. There are no branches and no tables: loops over them become
vector instructions.

Method: shrink the argument by a power of two until few terms of the Taylor series suffice, then square back.
`expm1(2t) = expm1(t) * (expm1(t) + 2)` does it without cancellation near zero.
"""

import numpy as np

from railctl.common.kernel import bare_kernel

Real = float | np.float64  # compiled, `float` of a float32 would stay one
LARGEST_EXPONENT = 104.0  # beyond, exp is zero or infinite in float32
LARGEST_TANH = 20.0  # beyond, tanh is one in float32 and in float64
TANH_BOUND = np.float32(7.90531110763549805)  # beyond, tanh is one in float32
TANH_ABOVE = tuple(  # from the highest power of the square down
    map(
        np.float32,
        (
            -2.76076847742355e-16,
            2.00018790482477e-13,
            -8.60467152213735e-11,
            5.12229709037114e-08,
            1.48572235717979e-05,
            6.37261928875436e-04,
            4.89352455891786e-03,
        ),
    )
)
TANH_BELOW = tuple(
    map(np.float32, (1.19825839466702e-06, 1.18534705686654e-04, 2.26843463243900e-03, 4.89352518554385e-03))
)
LARGEST_REDUCED = 1.5  # the logarithm's series is used between 1/1.5 and 1.5
FRACTION_BITS = 52  # of a float64: below them stand 11 bits of exponent
FRACTION = (1 << FRACTION_BITS) - 1
ROOT_OF_HALF = 0x3FE6A09E667F3BCD  # its bits
LEAST_NORMAL = 2.0**-1022
LARGEST_POWER = 1021.0  # the result is between 2 to the power of minus this and of this
ROUNDING = 1.5 * 2.0**52  # what is added to it is rounded to a whole number, which stands in the lowest bits


@bare_kernel
def series_expm1(t: Real) -> Real:
    """exp(t) - 1 for |t| below 0.5, to 1e-14 relative."""
    term = 1.0 + t * (1.0 / 12.0)
    term = 1.0 + t * (1.0 / 11.0) * term
    term = 1.0 + t * (1.0 / 10.0) * term
    term = 1.0 + t * (1.0 / 9.0) * term
    term = 1.0 + t * (1.0 / 8.0) * term
    term = 1.0 + t * (1.0 / 7.0) * term
    term = 1.0 + t * (1.0 / 6.0) * term
    term = 1.0 + t * (1.0 / 5.0) * term
    term = 1.0 + t * (1.0 / 4.0) * term
    term = 1.0 + t * (1.0 / 3.0) * term
    term = 1.0 + t * (1.0 / 2.0) * term
    return t * term


@bare_kernel
def exp(x: Real) -> Real:
    """e^x; arguments beyond +-104 count as +-104."""
    bounded = min(max(x, -LARGEST_EXPONENT), LARGEST_EXPONENT)
    power: Real = 1.0 + series_expm1(bounded * (1.0 / 256.0))
    for _ in range(8):
        power = power * power
    return power


@bare_kernel
def tanh(x: Real) -> Real:
    """The hyperbolic tangent; relative precision near zero too."""
    doubled = 2.0 * min(max(x, -LARGEST_TANH), LARGEST_TANH)
    below = series_expm1(doubled * (1.0 / 128.0))
    for _ in range(7):
        below = below * (below + 2.0)
    return below / (below + 2.0)


@bare_kernel
def tanh32(x: np.float32) -> np.float32:
    """The hyperbolic tangent in float32, to 3e-7 relative: a quotient of polynomials, as in the library Eigen.

    What networks compute between their layers, acting and learning: the same bits in both.
    """
    bounded = min(x, TANH_BOUND)
    bounded = max(bounded, -TANH_BOUND)
    square = bounded * bounded
    above = square * TANH_ABOVE[0] + TANH_ABOVE[1]
    above = square * above + TANH_ABOVE[2]
    above = square * above + TANH_ABOVE[3]
    above = square * above + TANH_ABOVE[4]
    above = square * above + TANH_ABOVE[5]
    above = square * above + TANH_ABOVE[6]
    below = square * TANH_BELOW[0] + TANH_BELOW[1]
    below = square * below + TANH_BELOW[2]
    below = square * below + TANH_BELOW[3]
    return bounded * above / below


@bare_kernel
def sigmoid(x: Real) -> Real:
    """1 / (1 + e^-x)."""
    power = exp(x)
    return power / (1.0 + power)


@bare_kernel
def log(x: Real) -> Real:
    """The natural logarithm of a positive number, as `k log 2 + 2 artanh((m - 1) / (m + 1))` with x = m 2^k."""
    exponent = 0.0
    while x > LARGEST_REDUCED:
        x *= 0.5
        exponent += 1.0
    while x < 1.0 / LARGEST_REDUCED:
        x *= 2.0
        exponent -= 1.0
    z = (x - 1.0) / (x + 1.0)
    square = z * z
    total: Real = 0.0
    for odd in range(23, -1, -2):
        total = total * square + 1.0 / odd
    return exponent * 0.6931471805599453 + 2.0 * z * total


@bare_kernel
def power(x: Real, exponent: Real) -> Real:
    """x^exponent for x of at least 2^-1022, which less counts as; the result is bounded by 2^-1021 and 2^1021.

    To 1e-14 relative while the result is between 2^-20 and 2^20. 1^y, x^0 and powers of two in whole numbers are exact.
    """
    bits = np.float64(max(x, LEAST_NORMAL)).view(np.int64) - ROOT_OF_HALF
    reduced = np.int64((bits & FRACTION) + ROOT_OF_HALF).view(np.float64)  # x over a power of two, in [0.7, 1.4]
    z = (reduced - 1.0) / (reduced + 1.0)
    square = z * z
    total: Real = 1.0 / 21.0
    total = total * square + 1.0 / 19.0
    total = total * square + 1.0 / 17.0
    total = total * square + 1.0 / 15.0
    total = total * square + 1.0 / 13.0
    total = total * square + 1.0 / 11.0
    total = total * square + 1.0 / 9.0
    total = total * square + 1.0 / 7.0
    total = total * square + 1.0 / 5.0
    total = total * square + 1.0 / 3.0
    total = total * square + 1.0
    log2: Real = np.float64(bits >> FRACTION_BITS) + 2.8853900817779268 * z * total
    log2 = min(max(exponent * log2, -LARGEST_POWER), LARGEST_POWER)
    rounded = np.float64(log2 + ROUNDING)
    fraction = 1.0 + series_expm1((log2 - (rounded - ROUNDING)) * 0.6931471805599453)
    return np.int64(np.float64(fraction).view(np.int64) + (rounded.view(np.int64) << FRACTION_BITS)).view(np.float64)
