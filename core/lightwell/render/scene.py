"""What is in a picture: objects, light and surroundings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count
from lightwell.geometry.mesh import Mesh
from lightwell.render.backdrop import Backdrop
from lightwell.render.light import Light
from lightwell.render.material import Material

Negatives = Literal["desaturate", "clip", "keep"]
Sampling = Literal["point", "vertex"]


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A mesh with its material and, for shadows, its precomputed transfer."""

    mesh: Mesh
    material: Material = field(default_factory=Material)
    transfer: NDArray[np.floating] | None = None
    """``(V, bands², C)``, C = 1 or 3: ``t_lm = ∫ V max(0, n·ω) Y_lm dω`` of each vertex, world axes, so that the
    irradiance is ``Σ t_lm c_lm`` (MATHS §9). None: no shadows, ``A_l Y_lm(n)``."""

    def __post_init__(self) -> None:
        if self.transfer is None:
            return
        shape = self.transfer.shape
        if len(shape) != 3 or shape[0] != len(self.mesh.positions) or shape[2] not in (1, 3):
            raise ValueError(
                f"the transfer of object {self.mesh.name!r} has the shape {shape}; it must be"
                f" ({len(self.mesh.positions)} vertices, bands², 1 or 3): compute it for this mesh"
            )
        bands_of_count(shape[1])
        if not np.isfinite(self.transfer).all():
            raise ValueError(f"the transfer of object {self.mesh.name!r} is not finite: compute it anew")


@dataclass(frozen=True, eq=False)
class Scene:
    """Objects in one light."""

    objects: tuple[SceneObject, ...]
    light: Light
    backdrop: Backdrop | None = None
    """None: black, without coverage, and mirrors show nothing."""
    negatives: Negatives = "desaturate"
    """What is done where irradiance or lobe ring below zero: as the browser, per channel, or nothing."""
    sampling: Sampling = "point"
    """Where the light is looked up and summed: at each visible point, or at vertices and interpolated."""
