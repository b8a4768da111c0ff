"""The transfer of a whole scene in one call; jobs do the same in parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Mesh
from lightwell.geometry.rays import RayScene
from lightwell.transfer.bounces import fill_hidden, gather, reflected
from lightwell.transfer.directions import Directions
from lightwell.transfer.surface import make_surface
from lightwell.transfer.visibility import SEEN, DirectTransfer, Tracer, error_of_halves, unshadowed

TransferMode = Literal["unshadowed", "shadowed", "interreflected"]
PART = 4096


@dataclass(frozen=True)
class Transfer:
    """Transfer at the vertices of a scene, mesh after mesh."""

    coefficients: Float32s
    """``(V, bands², channels)``: t_lm = ∫ V max(0, n·ω) Y_lm dω; E = Σ t c. 3 channels where bounces are coloured."""
    error: Float32s
    """``(V,)``: estimated error of the direct part (`error_of_halves`); 0 where it is exact."""
    state: NDArray[np.uint8]
    """``(V,)``: `lightwell.transfer.visibility.SEEN`, ``DARK`` or ``INSIDE``."""
    rays: int


def channels_of(meshes: Sequence[Mesh], mode: TransferMode) -> int:
    """Return 3 where bounces are coloured, else 1."""
    coloured = any(np.ptp(mesh.albedo, axis=1).max() > 1e-3 for mesh in meshes)
    return 3 if mode == "interreflected" and coloured else 1


def compute_transfer(
    meshes: Sequence[Mesh],
    directions: Directions,
    bands: int,
    mode: TransferMode = "shadowed",
    bounces: int = 1,
    turned: bool = True,
    threads: int = 1,
    check: Callable[[], None] = lambda: None,
) -> Transfer:
    """Return the transfer of meshes that shadow each other.

    Parameters
    ----------
    meshes
        At least one; ``directions`` and ``turned`` as in `Tracer`.
    bands
        1 … 11.
    mode
        ``unshadowed``: exact, ``A_l Y_lm(n)``. ``shadowed``: what is seen of the sky. ``interreflected``: and what
        comes by way of up to ``bounces`` surfaces.
    threads
        How many vertices' rays are traced at once.
    check
        Called often; may raise to stop.
    """
    surface = make_surface(meshes)
    channels = channels_of(meshes, mode)
    if mode == "unshadowed":
        exact = unshadowed(surface.merged.normals, bands)[:, :, None]
        return Transfer(exact, np.zeros(surface.count, np.float32), np.full(surface.count, SEEN, np.uint8), 0)
    scene = RayScene([surface.merged])

    def part(first: int) -> DirectTransfer:
        tracer = Tracer(surface, scene, directions, bands, turned)
        return tracer.direct(first, min(first + PART, surface.count), mode == "interreflected", check)

    with ThreadPoolExecutor(threads) as pool:
        direct = list(pool.map(part, range(0, surface.count, PART)))
    halves = np.concatenate([one.halves for one in direct])
    state = np.concatenate([one.state for one in direct])
    triangles = surface.merged.triangles
    total = fill_hidden(np.repeat(halves.sum(axis=1)[:, :, None], channels, axis=2), state, triangles)
    bounce = total
    for _ in range(bounces if mode == "interreflected" else 0):
        source = reflected(bounce, surface.merged.albedo[:, :channels])
        bounce = np.concatenate([gather(one.hits, one.hit_counts, triangles, source) for one in direct])
        bounce = fill_hidden(bounce, state, triangles)
        total = total + bounce
        check()
    return Transfer(total, error_of_halves(halves, bands), state, sum(one.rays for one in direct))
