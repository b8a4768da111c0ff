"""Cube maps: strips and crosses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.errors import MappingError
from lightwell.probe.footprint import centre_footprints
from lightwell.probe.mapping import Bools, Floats, Mapping, Samples

FACE_AXES = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    dtype=np.float64,
)
"""World axes of s (right), t (down the rows) and outwards for the faces +X −X +Y −Y +Z −Z, ``(6, 3, 3)``.

OpenGL 4.6 specification, table 8.19 ("Selection of cube map images").
"""


class Layout(NamedTuple):
    """Where the faces lie in the picture, in units of the face size."""

    columns: int
    rows: int
    cells: tuple[tuple[int, int], ...]
    """(row, column) of each face."""
    turned: int | None = None
    """Face that lies upside down."""


LAYOUTS = {
    "row strip": Layout(6, 1, tuple((0, face) for face in range(6))),
    "column strip": Layout(1, 6, tuple((face, 0) for face in range(6))),
    "horizontal cross": Layout(4, 3, ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3))),
    # Folded from a cross that stands upright, −Z hangs below −Y and is upside down, as in HDRShop's files.
    "vertical cross": Layout(3, 4, ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (3, 1)), turned=5),
}
"""Layouts; the picture's proportions tell which it is."""


class Cube(Mapping):
    """Six square faces in OpenGL's order +X −X +Y −Y +Z −Z and orientation, in world axes."""

    kind: ClassVar[str] = "cube"

    def __init__(self, height: int, width: int) -> None:
        super().__init__(height, width)
        for name, layout in LAYOUTS.items():
            if width * layout.rows == height * layout.columns and width % layout.columns == 0:
                self.layout_name, self.layout = name, layout
                self.face = width // layout.columns
                break
        else:
            raise MappingError(
                f"a picture of {width}×{height} pixels is no cube map: 6:1 (row strip), 1:6 (column strip), "
                "4:3 (horizontal cross) and 3:4 (vertical cross) of square faces are"
            )
        self._face_of_cell = np.full((self.layout.rows, self.layout.columns), -1)
        for face, (row, column) in enumerate(self.layout.cells):
            self._face_of_cell[row, column] = face

    def _locate(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return the face (−1: none) and the face coordinates a, b in −1 … 1 of picture points."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        column = np.clip(np.floor(x / self.face), 0, self.layout.columns - 1).astype(np.intp)
        row = np.clip(np.floor(y / self.face), 0, self.layout.rows - 1).astype(np.intp)
        face = np.where(self._is_in_picture(x, y), self._face_of_cell[row, column], -1)
        a, b = 2 * (x / self.face - column) - 1, 2 * (y / self.face - row) - 1
        turned = face == self.layout.turned
        return face, np.where(turned, -a, a), np.where(turned, -b, b)

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions of picture points, and whether they lie on a face."""
        face, a, b = self._locate(x, y)
        axes = FACE_AXES[face]
        q = a[..., None] * axes[..., 0, :] + b[..., None] * axes[..., 1, :] + axes[..., 2, :]
        return q / np.linalg.norm(q, axis=-1, keepdims=True), face >= 0

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions; every direction has one."""
        d = np.asarray(directions, dtype=np.float64)
        axis = np.argmax(np.abs(d), axis=-1)
        major = np.take_along_axis(d, axis[..., None], axis=-1)[..., 0]
        face = 2 * axis + (major < 0)
        axes = FACE_AXES[face]
        a = np.sum(d * axes[..., 0, :], axis=-1) / np.abs(major)
        b = np.sum(d * axes[..., 1, :], axis=-1) / np.abs(major)
        turned = face == self.layout.turned
        a, b = np.where(turned, -a, a), np.where(turned, -b, b)
        cells = np.array(self.layout.cells)[face]
        x = (cells[..., 1] + (a + 1) / 2) * self.face
        y = (cells[..., 0] + (b + 1) / 2) * self.face
        # Keep points on a face's far edge out of the cell beside it.
        x = np.minimum(x, np.nextafter((cells[..., 1] + 1.0) * self.face, 0))
        y = np.minimum(y, np.nextafter((cells[..., 0] + 1.0) * self.face, 0))
        return x, y, np.ones(face.shape, dtype=np.bool_)

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return ``(2/N)² / |q|³`` with ``q = (a, b, 1)`` and N the face size."""
        _, a, b = self._locate(x, y)
        return (2 / self.face) ** 2 / (a * a + b * b + 1) ** 1.5

    def solid_angles(self) -> Floats:
        """Return the exact solid angles ``(H, W)``: ``A(a, b) = atan2(ab, √(a²+b²+1))`` at the corners (MATHS §2.2)."""
        edge = np.linspace(-1, 1, self.face + 1)
        a, b = edge[None, :], edge[:, None]
        corner = np.arctan2(a * b, np.sqrt(a * a + b * b + 1))
        face = np.diff(np.diff(corner, axis=0), axis=1)
        table = np.zeros((self.height, self.width))
        for row, column in self.layout.cells:
            n = self.face
            table[row * n : (row + 1) * n, column * n : (column + 1) * n] = face
        return table

    def footprints(self) -> Iterator[Samples]:
        """Yield the centre of every pixel of the six faces, with its exact solid angle."""
        yield centre_footprints(self, self.coverage(), self.solid_angles())
