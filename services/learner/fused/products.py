# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The three matrix products of a dense layer, forwards and back, block by block.

Matrices are flat, row after row. Widths are multiples of 16. Rows go six at a time, the last six overlapping those
before: what is computed twice is the same twice. So there is room for six rows where there are fewer; what stands in
those that nobody asked for is never read.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel
from services.learner.fused.tile import HEIGHT, WIDTH, tile

_Floats = NDArray[np.float32]


@bare_kernel
def pack(matrix: _Floats, width: int, column: int, count: int, panel: _Floats) -> None:
    """Sixteen columns of a matrix [count, width], from `column` on, side by side [count, 16]."""
    for row in range(count):
        for k in range(WIDTH):
            panel[np.uint64(row * WIDTH + k)] = matrix[np.uint64(row * width + column + k)]


@bare_kernel
def pack_turned(matrix: _Floats, width: int, row: int, panel: _Floats) -> None:
    """Sixteen rows of a matrix [., width], from `row` on, as columns side by side [width, 16]."""
    for k in range(0, WIDTH, 8):  # eight at a time: so many rows are read along at once
        for column in range(width):
            for j in range(8):
                panel[np.uint64(column * WIDTH + k + j)] = matrix[np.uint64((row + k + j) * width + column)]


@bare_kernel
def forward(
    x: _Floats, rows: int, n_in: int, weight: _Floats, bias: _Floats, n_out: int, out: _Floats, panel: _Floats
) -> None:
    """Out [rows, n_out] = x [rows, n_in] weight [n_in, n_out] + bias [n_out]."""
    for column in range(0, n_out, WIDTH):
        pack(weight, n_out, column, n_in, panel)
        for first in range(0, rows, HEIGHT):
            row = max(min(first, rows - HEIGHT), 0)
            tile(x, row * n_in, n_in, 1, panel, n_in, bias, column, out, row * n_out + column, n_out)


@bare_kernel
def weight_gradient(
    x: _Floats,
    rows: int,
    n_in: int,
    by_out: _Floats,
    n_out: int,
    by_weight: _Floats,
    panel: _Floats,
    nothing: _Floats,
) -> None:
    """by_weight [n_in, n_out] = x^T by_out, for x [rows, n_in] and by_out [rows, n_out]; `nothing` [16] is zeros."""
    for column in range(0, n_out, WIDTH):
        pack(by_out, n_out, column, rows, panel)
        for first in range(0, n_in, HEIGHT):
            place = min(first, n_in - HEIGHT)
            tile(x, place, 1, n_in, panel, rows, nothing, 0, by_weight, place * n_out + column, n_out)


@bare_kernel
def input_gradient(
    by_out: _Floats,
    rows: int,
    n_out: int,
    weight: _Floats,
    n_in: int,
    by_x: _Floats,
    panel: _Floats,
    nothing: _Floats,
) -> None:
    """by_x [rows, n_in] = by_out [rows, n_out] weight^T, for weight [n_in, n_out]; `nothing` [16] is zeros."""
    for column in range(0, n_in, WIDTH):
        pack_turned(weight, n_out, column, panel)
        for first in range(0, rows, HEIGHT):
            row = max(min(first, rows - HEIGHT), 0)
            tile(by_out, row * n_out, n_out, 1, panel, n_out, nothing, 0, by_x, row * n_in + column, n_in)
