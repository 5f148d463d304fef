"""Steps of Adam.

"Adam: A Method for Stochastic Optimization", Kingma & Ba, arXiv:1412.6980, algorithm 1, with its betas and epsilon.
Additions, multiplications, divisions and square roots only, element by element: the same bits on every machine.
Moments that have faded below what float32 holds in full are zero: processors take a hundred times as long over them.
"""

import math

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8
LEAST = np.float32(2.0**-126)


@bare_kernel
def corrections(learning_rate: float, steps: int) -> tuple[np.float32, np.float32]:
    """What makes up for moments that began at zero, `steps` steps ago: the rate, and a factor of their roots."""
    left_1, left_2 = 1 - whole_power(BETA_1, steps), 1 - whole_power(BETA_2, steps)
    return np.float32(learning_rate / left_1), np.float32(1 / math.sqrt(left_2))


@bare_kernel
def whole_power(base: float, exponent: int) -> float:
    """By products alone: a system's own function differs between versions of its library."""
    result = 1.0
    while exponent > 0:
        if exponent % 2 == 1:
            result *= base
        base *= base
        exponent //= 2
    return result


@bare_kernel
def move(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    values: NDArray[np.float32],
    gradient: NDArray[np.float32],
    mean: NDArray[np.float32],
    square: NDArray[np.float32],
    scale: np.float32,
    rate: np.float32,
    inverse_root: np.float32,
) -> None:
    """One step along a gradient [P] times `scale`; the other two scalars are `corrections`."""
    keep_1, keep_2, epsilon = np.float32(BETA_1), np.float32(BETA_2), np.float32(EPSILON)
    take_1, take_2, zero = np.float32(1 - BETA_1), np.float32(1 - BETA_2), np.float32(0)
    for i in range(len(values)):
        slope = gradient[i] * scale
        first = keep_1 * mean[i] + take_1 * slope
        second = keep_2 * square[i] + take_2 * (slope * slope)
        mean[i] = zero if abs(first) < LEAST else first
        square[i] = zero if second < LEAST else second
        values[i] -= rate * mean[i] / (np.sqrt(square[i]) * inverse_root + epsilon)
