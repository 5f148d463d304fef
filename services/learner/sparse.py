"""Linear layers over rows that are mostly zeros: only the weights of what is not zero are read.

About 95% of a tree observation is exact zeros (see `common.rail.normalise`), and the first layer has most of a
network's weights. Sums run over a row's own non-zeros in ascending order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int64]
_Bits = NDArray[np.uint32]
WITHOUT_SIGN = np.uint32(0x7FFFFFFF)  # -0 is zero too


class SparseRows(NamedTuple):
    """What is not zero in R rows of F numbers, row after row.

    Attributes:
        shape: [..., F], of the array that it was; R is the product of all but F.
        starts: [R + 1], where each row begins in the other two.
        columns: [at least all], in ascending order for each row.
        values: [at least all].
    """

    shape: tuple[int, ...]
    starts: _Ints
    columns: _Ints
    values: _Floats

    @property
    def n_rows(self) -> int:
        return len(self.starts) - 1


Observations = NDArray[np.float32] | SparseRows  # [..., F]


def sparse_rows(x: Observations) -> SparseRows:
    """The rows of x [..., F], an array being contiguous."""
    if isinstance(x, SparseRows):
        return x
    dense = x.view(np.uint32).reshape(-1, x.shape[-1])
    starts = np.empty(len(dense) + 1, np.int64)
    columns, values = np.empty(dense.size + 1, np.int64), np.empty(dense.size + 1, np.float32)
    find(dense, starts, columns, values.view(np.uint32))
    return SparseRows(x.shape, starts, columns, values)


def dense_rows(x: Observations) -> NDArray[np.float32]:
    """The rows of x [..., F] with their zeros."""
    if isinstance(x, np.ndarray):
        return x
    dense = np.zeros((x.n_rows, x.shape[-1]), np.float32)
    count = x.starts[-1]
    rows = np.repeat(np.arange(x.n_rows), np.diff(x.starts))
    dense[rows, x.columns[:count]] = x.values[:count]
    return dense.reshape(x.shape)


@bare_kernel
def find(x: _Bits, starts: _Ints, columns: _Ints, values: _Bits) -> None:
    """Fill a `SparseRows` from the bits of x [R, F].

    Eight numbers at a time are looked at, and passed by if all are zeros. Otherwise each is written where the next one
    belongs, so that nothing hangs on how they are mixed. Indices are unsigned because compiled code would test signed
    ones for being negative.
    """
    count, whole = 0, x.shape[1] // 8 * 8
    for row in range(len(x)):
        starts[row] = count
        numbers = x[row]
        for first in range(0, whole, 8):
            something = np.uint32(0)
            for k in range(8):
                something |= numbers[np.uint64(first + k)]
            if something & WITHOUT_SIGN:
                for k in range(8):
                    count += note(numbers, first + k, count, columns, values)
        for column in range(whole, len(numbers)):
            count += note(numbers, column, count, columns, values)
    starts[len(x)] = count


@bare_kernel
def note(numbers: _Bits, column: int, place: int, columns: _Ints, values: _Bits) -> bool:
    """Write a number of a row to a place; returns whether it is not zero, so that the next one goes behind it."""
    number = numbers[np.uint64(column)]
    columns[place], values[place] = column, number
    return bool(number & WITHOUT_SIGN)


@bare_kernel
def multiply(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    starts: _Ints, columns: _Ints, values: _Floats, weight: _Floats, bias: _Floats, out: _Floats
) -> None:
    """Let `out` be x weight + bias, for weight [F, H], bias [H], out [R, H].

    Four rows of the weights at a time, to load and store the sums less often.
    """
    for row in range(len(out)):
        sums, first, last = out[row], starts[row], starts[row + 1]
        for k in range(len(bias)):
            sums[k] = bias[k]
        whole = first + (last - first) // 4 * 4
        for at in range(first, whole, 4):
            x0, x1, x2, x3 = values[at], values[at + 1], values[at + 2], values[at + 3]
            w0, w1 = weight[columns[at]], weight[columns[at + 1]]
            w2, w3 = weight[columns[at + 2]], weight[columns[at + 3]]
            for k in range(len(bias)):
                sums[k] = sums[k] + x0 * w0[k] + x1 * w1[k] + x2 * w2[k] + x3 * w3[k]
        for at in range(whole, last):
            x0, w0 = values[at], weight[columns[at]]
            for k in range(len(bias)):
                sums[k] += x0 * w0[k]


@bare_kernel
def accumulate(starts: _Ints, columns: _Ints, values: _Floats, gradient: _Floats, out: _Floats) -> None:
    """Let `out` be x^T gradient, the gradient of the weights [F, H], from that of the sums [R, H]."""
    out[:] = np.float32(0)
    for row in range(len(gradient)):
        sums = gradient[row]
        for at in range(starts[row], starts[row + 1]):
            x, weights = values[at], out[columns[at]]
            for k in range(len(sums)):
                weights[k] += x * sums[k]
