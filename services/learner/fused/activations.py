"""What stands between layers, in place, and the way back."""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import tanh32

_Floats = NDArray[np.float32]
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


@bare_kernel
def activate(x: _Floats, smooth: bool) -> None:
    """Tanh of x [n] if `smooth`, else ReLU."""
    if smooth:
        for i in range(len(x)):
            x[i] = tanh32(x[i])
    else:
        for i in range(len(x)):
            x[i] = max(x[i], _ZERO)  # what is not a number shall show


@bare_kernel
def differentiate(y: _Floats, smooth: bool, gradient: _Floats) -> None:
    """From outputs [n] and their gradient to that of the inputs."""
    if smooth:
        for i in range(len(y)):
            gradient[i] = gradient[i] * (_ONE - y[i] * y[i])
    else:
        for i in range(len(y)):
            gradient[i] = gradient[i] if y[i] > _ZERO else _ZERO


@bare_kernel
def sigmoid32(x: np.float32) -> np.float32:
    """1 / (1 + e^-x) in float32, to 2e-7."""
    return _HALF * tanh32(_HALF * x) + _HALF
