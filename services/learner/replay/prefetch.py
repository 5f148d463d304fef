"""Asking memory for something before it is needed, from compiled code: the processor's own instruction.

Random places of a large array come one by one if each is waited for, and many at a time if all are asked for first.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

READ, KEEP, DATA = 0, 3, 1  # as LLVM's intrinsic numbers them
INT32 = ir.IntType(32)
tools: Any = cgutils  # which has no types


def _prefetch(_typing: Any, array: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        struct = context.make_array(array)(context, builder, arguments[0])
        place = context.cast(builder, arguments[1], index, types.intp)
        pointer = tools.get_item_pointer(context, builder, array, struct, [place], wraparound=False)
        pointer = builder.bitcast(pointer, tools.voidptr_t)
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, INT32, INT32, INT32])
        function = builder.module.declare_intrinsic("llvm.prefetch", [pointer.type], kind)
        builder.call(function, [pointer, INT32(READ), INT32(KEEP), INT32(DATA)])
        return context.get_dummy_value()

    return types.void(array, index), generate


# prefetch(array, index) brings the cache line of array[index] nearer; an index outside does no harm.
prefetch = cast("Callable[[Any, int], None]", intrinsic(_prefetch))
