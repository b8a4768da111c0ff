"""Asking for memory before it is needed, inside numba kernels."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

CACHE_LINE_BYTES = 64

# These parts of numba carry no types.
_arrays: Any = arrayobj
_codegen: Any = cgutils


def _prefetch(typing_context: Any, array: Any, row: Any, column: Any) -> Any:  # noqa: ANN401
    def touch(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        array_type = signature.args[0]
        held = _arrays.make_array(array_type)(context, builder, arguments[0])
        element = _codegen.get_item_pointer(
            context, builder, array_type, held, [arguments[1], arguments[2]], wraparound=False
        )
        address = builder.bitcast(element, ir.IntType(8).as_pointer())
        flag = ir.IntType(32)
        function_type = ir.FunctionType(ir.VoidType(), [address.type, flag, flag, flag])
        function = _codegen.get_or_insert_function(builder.module, function_type, "llvm.prefetch.p0")
        read, keep_in_all_caches, data = flag(0), flag(3), flag(1)
        builder.call(function, [address, read, keep_in_all_caches, data])
        return context.get_dummy_value()

    return types.void(array, row, column), touch


prefetch: Any = intrinsic(_prefetch)
"""``prefetch(array, i, j)`` in a kernel: bring the cache line of ``array[i, j]`` nearer. Nothing is read or checked."""
