"""A block of a matrix product in the processor's registers, from LLVM's own vectors.

Numba's loops load and store a sum for every product. Here 6 x 16 sums stay in registers from the first product to the
last. Each grows by one product after the other, rounded, then added, also rounded: the bits of the plain loop over
float32, whatever vectors a processor has. No fused multiply-add, which would round once.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

HEIGHT, WIDTH = 6, 16  # sums of a block: 12 registers of 8 numbers, which leaves 4 for what goes in
LANES = 8
FLOAT32, INT32, INT64 = ir.FloatType(), ir.IntType(32), ir.IntType(64)
VECTOR = ir.VectorType(FLOAT32, LANES)
UNALIGNED = 4  # bytes: any float32
ARRAYS = {"x": 0, "panel": 4, "start": 6, "out": 9}
NUMBERS = {"at": 1, "across": 2, "along": 3, "count": 5, "start_at": 7, "start_width": 8, "out_at": 10, "out_width": 11}


def _number(value: int) -> Any:
    return ir.Constant(INT64, value)


def _vector_at(builder: Any, pointer: Any, place: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [place]), VECTOR.as_pointer())


def _splat(builder: Any, number: Any) -> Any:
    """A vector of the same number."""
    anything = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(anything, number, ir.Constant(INT32, 0))
    return builder.shuffle_vector(first, anything, ir.Constant(ir.VectorType(INT32, LANES), [0] * LANES))


def _emit(builder: Any, array: dict[str, Any], number: dict[str, Any]) -> None:
    """The loop over what is multiplied; `array` holds pointers."""
    columns = [_number(first) for first in range(0, WIDTH, LANES)]
    before, body, done = builder.block, builder.append_basic_block("body"), builder.append_basic_block("done")
    begun = []
    for r in range(HEIGHT):
        start = builder.add(number["start_at"], builder.mul(_number(r), number["start_width"]))
        places = [_vector_at(builder, array["start"], builder.add(start, column)) for column in columns]
        begun.append([builder.load(place, align=UNALIGNED) for place in places])
    builder.branch(body)
    builder.position_at_end(body)
    k = builder.phi(INT64)
    k.add_incoming(_number(0), before)
    sums = [[builder.phi(VECTOR) for _ in columns] for _ in range(HEIGHT)]
    row = builder.mul(k, _number(WIDTH))
    taken = [
        builder.load(_vector_at(builder, array["panel"], builder.add(row, column)), align=UNALIGNED)
        for column in columns
    ]
    first = builder.add(number["at"], builder.mul(k, number["along"]))
    grown = []
    for r in range(HEIGHT):
        place = builder.add(first, builder.mul(_number(r), number["across"]))
        factor = _splat(builder, builder.load(builder.gep(array["x"], [place])))
        grown.append([builder.fadd(sums[r][j], builder.fmul(factor, taken[j])) for j in range(len(columns))])
    following = builder.add(k, _number(1))
    k.add_incoming(following, body)
    for r in range(HEIGHT):
        for j in range(len(columns)):
            sums[r][j].add_incoming(begun[r][j], before)
            sums[r][j].add_incoming(grown[r][j], body)
    builder.cbranch(builder.icmp_signed("<", following, number["count"]), body, done)
    builder.position_at_end(done)
    for r in range(HEIGHT):
        start = builder.add(number["out_at"], builder.mul(_number(r), number["out_width"]))
        for j, column in enumerate(columns):
            builder.store(grown[r][j], _vector_at(builder, array["out"], builder.add(start, column)), align=UNALIGNED)


def _tile(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    _typing: Any,
    x: Any,
    at: Any,
    across: Any,
    along: Any,
    panel: Any,
    count: Any,
    start: Any,
    start_at: Any,
    start_width: Any,
    out: Any,
    out_at: Any,
    out_width: Any,
) -> Any:
    given = (x, at, across, along, panel, count, start, start_at, start_width, out, out_at, out_width)
    wanted = [types.int64 if place in NUMBERS.values() else kind for place, kind in enumerate(given)]

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointers = {
            name: context.make_array(signature.args[place])(context, builder, arguments[place]).data
            for name, place in ARRAYS.items()
        }
        _emit(builder, pointers, {name: arguments[place] for name, place in NUMBERS.items()})
        return context.get_dummy_value()

    return types.void(*wanted), generate


# tile(x, at, across, along, panel, count, start, start_at, start_width, out, out_at, out_width), of flat arrays of
# float32: for 6 rows r and 16 columns j, out[out_at + r out_width + j] = start[start_at + r start_width + j] + the sum
# over k, ascending, of x[at + r across + k along] panel[16 k + j]. Nothing is checked; count is at least 1.
tile = cast("Callable[..., None]", intrinsic(_tile))
