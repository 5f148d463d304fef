# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""The three matrix products of a dense layer, forwards and back, block by block.

Matrices are flat, row after row. Widths are multiples of 16. Rows go six at a time, the last six overlapping those
before: what is computed twice is the same twice. So there is room for six rows where there are fewer; what stands in
those that nobody asked for is never read.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.services.learner.fused.tile import HEIGHT, WIDTH, tile

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
def multiply_panel(
    x: _Floats,
    rows: int,
    n_in: int,
    panel: _Floats,
    start: _Floats,
    start_width: int,
    column: int,
    n_out: int,
    out: _Floats,
) -> None:
    """Sixteen columns of `out` [rows, n_out], from `column` on: those of `start`, and x [rows, n_in] times the panel.

    `start` is a matrix of this width, or a vector for all rows, whose `start_width` is 0.
    """
    for first in range(0, rows, HEIGHT):
        row = max(min(first, rows - HEIGHT), 0)
        begun, place = row * start_width + column, row * n_out + column
        tile(x, row * n_in, n_in, 1, panel, n_in, start, begun, start_width, out, place, n_out)


@bare_kernel
def pack_panels(matrix: _Floats, n_in: int, n_out: int, panels: _Floats) -> None:
    """All columns of a matrix [n_in, n_out], panel by panel."""
    for column in range(0, n_out, WIDTH):
        pack(matrix, n_out, column, n_in, panels[column * n_in :])


@bare_kernel
def pack_panels_turned(matrix: _Floats, n_in: int, n_out: int, panels: _Floats) -> None:
    """All rows of a matrix [n_in, n_out], panel by panel."""
    for row in range(0, n_in, WIDTH):
        pack_turned(matrix, n_out, row, panels[row * n_out :])


@bare_kernel
def multiply_panels(
    x: _Floats, rows: int, n_in: int, panels: _Floats, start: _Floats, start_width: int, n_out: int, out: _Floats
) -> None:
    """Out [rows, n_out] = x [rows, n_in] times all panels + start, see `multiply_panel`."""
    for column in range(0, n_out, WIDTH):
        multiply_panel(x, rows, n_in, panels[column * n_in :], start, start_width, column, n_out, out)


@bare_kernel
def forward(
    x: _Floats, rows: int, n_in: int, weight: _Floats, bias: _Floats, n_out: int, out: _Floats, panel: _Floats
) -> None:
    """Out [rows, n_out] = x [rows, n_in] weight [n_in, n_out] + bias [n_out]."""
    for column in range(0, n_out, WIDTH):
        pack(weight, n_out, column, n_in, panel)
        multiply_panel(x, rows, n_in, panel, bias, 0, column, n_out, out)


@bare_kernel
def weight_gradient(
    x: _Floats,
    rows: int,
    n_in: int,
    by_out: _Floats,
    n_out: int,
    start: _Floats,
    start_width: int,
    by_weight: _Floats,
    panel: _Floats,
) -> None:
    """by_weight [n_in, n_out] = x^T by_out + start, for x [rows, n_in], by_out [rows, n_out]; see `multiply_panel`.

    `start` is not `by_weight`: its last rows would be added to twice.
    """
    for column in range(0, n_out, WIDTH):
        pack(by_out, n_out, column, rows, panel)
        for first in range(0, n_in, HEIGHT):
            row = min(first, n_in - HEIGHT)
            begun, place = row * start_width + column, row * n_out + column
            tile(x, row, 1, n_in, panel, rows, start, begun, start_width, by_weight, place, n_out)


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
    """by_x [rows, n_in] = by_out [rows, n_out] weight^T, for weight [n_in, n_out]; `nothing` [n_in] is zeros."""
    for column in range(0, n_in, WIDTH):
        pack_turned(weight, n_out, column, panel)
        multiply_panel(by_out, rows, n_out, panel, nothing, 0, column, n_in, by_x)
