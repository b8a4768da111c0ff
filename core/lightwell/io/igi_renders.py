"""Writing pictures by virtual point lights: OpenEXR with all layers, PNG as a screen shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import RenderError
from lightwell.igi.rendering import IgiRendering
from lightwell.io.files import write_atomically
from lightwell.io.renders import picture_png, require_format, write_exr_layers


def write_igi_rendering(
    path: Path, rendering: IgiRendering, ev: float = 0.0, *, tone_mapping: bool = True, backdrop: bool = True
) -> None:
    """Write a rendering; the file appears whole or not at all.

    ``.exr`` holds linear radiance in float, ``R G B A`` and ``coverage``, and those of the layers that were rendered:
    ``Z`` (metres along the viewing axis, infinite where nothing is), ``normal.X Y Z`` (world), ``albedo.R G B``,
    ``direct.R G B``, ``indirect.R G B``, ``set`` and ``sh.k.R G B``, k the index of the coefficient; exposure is left
    to the reader. ``.png`` holds sRGB of eight bits after exposure and tone mapping. Without ``backdrop``, what is
    behind the objects is black and transparent.

    Raises
    ------
    RenderError
        Where the name has another ending or the file cannot be written.
    """
    require_format(path)
    try:
        if path.suffix.lower() == ".exr":
            write_exr_layers(path, igi_layers(rendering, backdrop=backdrop))
        else:
            write_atomically(path, igi_png(rendering, ev, tone_mapping=tone_mapping, backdrop=backdrop))
    except (OSError, RuntimeError) as error:
        raise RenderError(f"{path}: cannot be written: {error}; give another file") from None


def igi_png(rendering: IgiRendering, ev: float = 0.0, *, tone_mapping: bool = True, backdrop: bool = True) -> bytes:
    """Return a rendering as PNG: RGB with its backdrop, else RGBA where something is not covered."""
    coverage = None if backdrop or rendering.coverage.min() == 1 else rendering.coverage
    return picture_png(rendering.shown(backdrop), coverage, ev, tone_mapping=tone_mapping)


def igi_layers(rendering: IgiRendering, *, backdrop: bool = True) -> dict[str, NDArray[np.float32]]:
    """Return the channels of an OpenEXR file, ``(H, W)`` float32 each."""
    coverage = rendering.coverage
    colour = rendering.shown(backdrop)
    found = {channel: colour[..., i] for i, channel in enumerate("RGB")}
    found |= {"A": np.ones_like(coverage) if backdrop else coverage, "coverage": coverage}
    if rendering.depth is not None:
        found["Z"] = rendering.depth
    if rendering.set is not None:
        found["set"] = rendering.set.astype(np.float32)
    direct = rendering.direct
    if direct is not None and backdrop:
        direct = direct + rendering.behind
    vectors = {
        "normal": ("XYZ", rendering.normal),
        "albedo": ("RGB", rendering.albedo),
        "direct": ("RGB", direct),
        "indirect": ("RGB", rendering.indirect),
    }
    if rendering.coefficients is not None:
        for k in range(rendering.coefficients.shape[2]):
            vectors[f"sh.{k}"] = ("RGB", rendering.coefficients[:, :, k])
    for name, (channels, values) in vectors.items():
        if values is not None:
            found |= {f"{name}.{channel}": values[..., i] for i, channel in enumerate(channels)}
    return found
