"""Reading half-float samples inside numba kernels, which have no float16 of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from lightwell.errors import MappingError

Picture = NDArray[np.float16] | NDArray[np.float32]
"""A picture ``(H, W, 3)`` of linear RGB."""


def _to_float32(typing_context: Any, sample: Any) -> Any:  # noqa: ANN401
    if sample == types.float32:
        return types.float32(types.float32), lambda context, builder, signature, arguments: arguments[0]
    if sample == types.uint16:

        def widen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
            return builder.fpext(builder.bitcast(arguments[0], ir.HalfType()), ir.FloatType())

        return types.float32(types.uint16), widen
    return None


to_float32: Any = intrinsic(_to_float32)
"""``to_float32(sample)`` in a kernel: uint16 bits of a half, or a float32, as float32.

The half goes through LLVM's ``fpext``, so that loops over it become ``vcvtph2ps``.
"""


def sample_rows(image: Picture, height: int, width: int) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Return a picture as rows of samples that kernels read with `to_float32`, ``(H, 3W)``, without a copy if it can.

    Raises
    ------
    MappingError
        Where the picture is not ``(height, width, 3)``.
    ValueError
        Where its samples are neither float16 nor float32.
    """
    if image.shape != (height, width, 3):
        raise MappingError(f"the picture has the shape {image.shape}, the mapping is for ({height}, {width}, 3)")
    rows = np.ascontiguousarray(image).reshape(height, 3 * width)
    if rows.dtype == np.float16:
        return rows.view(np.uint16)
    if rows.dtype == np.float32:
        return rows.view(np.float32)
    raise ValueError(f"pictures are float16 or float32, not {image.dtype}")
