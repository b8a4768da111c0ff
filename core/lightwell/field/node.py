"""One node of a lattice as one vector: numba does not merge four neighbouring additions by itself.

The splat spends most of its time here; four scalar additions take 2.5 times as long.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _add_weighted(
    typingctx: Any,
    array: Any,
    index: Any,
    weight: Any,
    red: Any,
    green: Any,
    blue: Any,
) -> Any:
    """Add ``weight · (red, green, blue, 1)`` to ``array[index : index + 4]``, flat float32; bounds are not checked."""
    del typingctx, index, weight, red, green, blue
    signature = types.void(array, types.intp, *[types.float32] * 4)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        single, four = ir.FloatType(), ir.VectorType(ir.FloatType(), 4)
        data, place, factor, *colour = arguments
        pointer = builder.gep(context.make_array(signature.args[0])(context, builder, data).data, [place])
        pointer = builder.bitcast(pointer, four.as_pointer())
        values, factors = ir.Constant(four, ir.Undefined), ir.Constant(four, ir.Undefined)
        for lane, value in enumerate([*colour, ir.Constant(single, 1.0)]):
            position = ir.Constant(ir.IntType(32), lane)
            values = builder.insert_element(values, value, position)
            factors = builder.insert_element(factors, factor, position)
        product = builder.fmul(factors, values, flags=("contract",))
        total = builder.fadd(product, builder.load(pointer, align=4), flags=("contract",))
        builder.store(total, pointer, align=4)
        return context.get_dummy_value()

    return signature, generate


add_weighted: Any = intrinsic(_add_weighted)
