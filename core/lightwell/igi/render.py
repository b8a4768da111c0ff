"""The picture, tile by tile: see, gather, filter, shade (paper 004 §3)."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.filter import filtered, margins
from lightwell.igi.gather import Gatherer
from lightwell.igi.gbuffer import GBuffer, look, require_outside
from lightwell.igi.scene import IgiScene
from lightwell.igi.shade import Responses, responses
from lightwell.igi.surfaces import Singles, Surfaces
from lightwell.igi.virtual import make_virtual_lights
from lightwell.igi_settings import IgiSettings
from lightwell.render.camera import Camera, require_size

TILE = 128
"""Pixels along each side of a tile, unless it is said."""


class Tile(NamedTuple):
    """A rectangle of pixels: rows ``top … bottom − 1``, columns ``left … right − 1``."""

    top: int
    bottom: int
    left: int
    right: int


@dataclass(frozen=True, eq=False)
class IgiRendering:
    """A picture or a tile of one, ``(H, W, …)`` float32, row 0 is the top; layers that were not asked for are None."""

    colour: Singles
    """``(H, W, 3)`` linear radiance, Rec. 709: the sky where nothing is seen, black where there is none."""
    coverage: Singles
    """``(H, W)``: 1 where there is a surface, else 0."""
    normal: Singles | None
    """``(H, W, 3)`` unit normals that materials go by, world axes; zero where nothing is seen."""
    depth: Singles | None
    """``(H, W)`` metres along the viewing axis; infinite where nothing is seen."""
    albedo: Singles | None
    """``(H, W, 3)``: reflectivity, of the matte part and the lobe together; zero where nothing is seen."""
    direct: Singles | None
    """``(H, W, 3)``: emission, reflected light of lamps and sky, and the sky itself; with `indirect` the colour."""
    indirect: Singles | None
    """``(H, W, 3)``: reflected light that has been reflected before."""
    set: NDArray[np.uint16] | None
    """``(H, W)``: which set of lights was the pixel's own."""
    coefficients: Singles | None
    """``(H, W, bands², 3)``: incident radiance after the filter; with the filters of irradiance, before them."""
    arrived: float
    """Light that arrived at the pixels, summed over lights and channels, with what the filter needs around them."""
    clamped: float
    """What would have come on top without the clamp."""
    rays: int
    """Shadow rays."""

    @property
    def clamp_bias(self) -> float:
        """Share of the light that the clamp takes away."""
        whole = self.arrived + self.clamped
        return self.clamped / whole if whole > 0 else 0.0


class IgiRenderer:
    """A scene with its virtual lights, which serve any camera; immutable, for any number of threads."""

    def __init__(self, scene: IgiScene, settings: IgiSettings, surfaces: Surfaces | None = None) -> None:
        """Make the virtual lights of a scene; ``surfaces`` are those of its objects where there are some already."""
        self.settings = settings
        self.surfaces = surfaces or Surfaces(scene)
        self.lights = make_virtual_lights(scene, self.surfaces, settings)
        self._sky = scene.sky
        self._gatherer = Gatherer(self.surfaces.rays, self.lights, settings.bands)
        self._groups = 2 if {"direct", "indirect"} & set(settings.layers) else 1

    def tile(
        self, camera: Camera, size: tuple[int, int], tile: Tile, check: Callable[[], None] | None = None
    ) -> IgiRendering:
        """Return a tile of a picture; its pixels are the same, to the last bit, in whatever tiles that is cut.

        ``check`` is called every few milliseconds; what it raises ends the work.
        """
        settings = self.settings
        left, right, up, down = reach = self._reach()
        rows, columns = (tile.top - up, tile.bottom + down), (tile.left - left, tile.right + right)
        wide = look(self.surfaces, camera, size, rows, columns)
        gathered = self._gatherer.gather(
            wide.place, wide.geometric, wide.seen, (columns[0], rows[0]), self._groups, check
        )
        inner = _inner(wide, reach)
        coefficients = gathered.coefficients
        if settings.filter == "sh":
            coefficients = self._filter(coefficients, wide, reach, strict=False)
            received = self._receive(coefficients, inner)
        else:
            received = self._receive(coefficients, wide)
            coefficients = coefficients[up : coefficients.shape[0] - down, left : coefficients.shape[1] - right]
            if settings.filter != "none":
                both = np.stack(received, axis=2)
                both = self._filter(both, wide, reach, strict=settings.filter == "irradiance-strict")
                received = Responses(both[:, :, 0], both[:, :, 1])
        reflected = inner.kd[:, :, None] * received.matte + inner.ks[:, :, None] * received.lobe
        direct = inner.emission + reflected[:, :, 0]
        if self._sky is not None and not inner.seen.all():
            direct[~inner.seen] = self._sky.radiance(inner.view[~inner.seen].astype(np.float64))
        wanted = set(settings.layers)
        n, m = settings.sets
        turn = np.arange(tile.left, tile.right) % n + n * (np.arange(tile.top, tile.bottom) % m)[:, None]
        return IgiRendering(
            direct + reflected[:, :, 1] if self._groups == 2 else direct,
            inner.seen.astype(np.float32),
            inner.shading if "normal" in wanted else None,
            inner.depth if "depth" in wanted else None,
            inner.kd + inner.ks if "albedo" in wanted else None,
            direct if "direct" in wanted else None,
            reflected[:, :, 1] if "indirect" in wanted else None,
            turn.astype(np.uint16) if "set" in wanted else None,
            coefficients.sum(axis=2) if "coefficients" in wanted else None,
            gathered.arrived,
            gathered.clamped,
            gathered.rays,
        )

    def _reach(self) -> tuple[int, int, int, int]:
        if self.settings.filter == "none":
            return 0, 0, 0, 0
        return margins(self.settings.sets, self.settings.window)

    def _filter(self, values: Singles, wide: GBuffer, reach: tuple[int, int, int, int], strict: bool) -> Singles:
        """Return the filtered values ``(H', W', …)`` of ``(H, W, …)``."""
        flat = values.reshape(*values.shape[:2], -1)
        means = filtered(flat, wide.seen, wide.place, wide.geometric, wide.shading, wide.depth, reach, strict)
        return means.reshape(*means.shape[:2], *values.shape[2:])

    def _receive(self, coefficients: Singles, seen: GBuffer) -> Responses:
        """Return what surfaces get, ``(H, W, G, 3)``; zero where nothing is seen."""
        # Pixels without a surface have no coefficients and no lobe.
        count = seen.seen.size
        matte, lobe = responses(
            coefficients.reshape(count, *coefficients.shape[2:]),
            seen.shading.reshape(count, 3),
            seen.view.reshape(count, 3),
            seen.geometric.reshape(count, 3),
            seen.exponent.reshape(count),
            np.asarray(seen.ks.reshape(count, 3).max(axis=1) > 0),
            self.settings.kernel,
            self.settings.bands,
        )
        shape = (*seen.seen.shape, coefficients.shape[2], 3)
        return Responses(matte.reshape(shape), lobe.reshape(shape))


def cut(size: tuple[int, int], side: int = TILE) -> list[Tile]:
    """Return the tiles of a picture, row by row; those at the right and lower edges may be smaller."""
    width, height = size
    return [
        Tile(top, min(top + side, height), left, min(left + side, width))
        for top in range(0, height, side)
        for left in range(0, width, side)
    ]


def assemble(size: tuple[int, int], parts: list[tuple[Tile, IgiRendering]]) -> IgiRendering:
    """Return a picture of all its tiles."""
    width, height = size
    layers: dict[str, NDArray[Any] | None] = {}
    for name in ("colour", "coverage", "normal", "depth", "albedo", "direct", "indirect", "set", "coefficients"):
        example = getattr(parts[0][1], name)
        if example is None:
            layers[name] = None
            continue
        whole = np.empty((height, width, *example.shape[2:]), example.dtype)
        for tile, part in parts:
            whole[tile.top : tile.bottom, tile.left : tile.right] = getattr(part, name)
        layers[name] = whole
    return IgiRendering(
        **layers,  # type: ignore[arg-type]
        arrived=sum(part.arrived for _, part in parts),
        clamped=sum(part.clamped for _, part in parts),
        rays=sum(part.rays for _, part in parts),
    )


def render_igi(
    scene: IgiScene,
    camera: Camera,
    size: tuple[int, int],
    settings: IgiSettings,
    progress: Callable[[int, int], None] | None = None,
    check: Callable[[], None] | None = None,
    tile: int = TILE,
    threads: int | None = None,
) -> IgiRendering:
    """Render a picture.

    Parameters
    ----------
    scene, camera
        What is seen, and from where.
    size
        Width and height in pixels.
    settings
        Sets, lights, bands, filter, seed. The same ones give the same bytes, whatever ``tile`` and ``threads`` are.
    progress
        Called with the tiles that are done and how many there are.
    check
        Called every few milliseconds, from any thread; what it raises ends the work.
    tile
        Pixels along each side of a tile: more take more memory and do less work twice.
    threads
        How many work at once; by default as many as there are cores.

    Raises
    ------
    ValueError
        Where the size is out of range.
    RenderError
        Where the camera stands inside an object.
    """
    require_size(size)
    if tile < 1:
        raise ValueError(f"tile = {tile} must be at least 1")
    renderer = IgiRenderer(scene, settings)
    require_outside(renderer.surfaces, camera)
    tiles = cut(size, tile)
    parts: list[tuple[Tile, IgiRendering]] = []
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        futures = [pool.submit(renderer.tile, camera, size, one, check) for one in tiles]
        try:
            for one, future in zip(tiles, futures, strict=True):
                parts.append((one, future.result()))
                if progress is not None:
                    progress(len(parts), len(tiles))
        except BaseException:
            for future in futures:
                future.cancel()
            raise
    return assemble(size, parts)


def _inner(wide: GBuffer, reach: tuple[int, int, int, int]) -> GBuffer:
    """Return the rectangle without its margins."""
    left, right, up, down = reach
    rows, columns = slice(up, wide.seen.shape[0] - down), slice(left, wide.seen.shape[1] - right)
    return GBuffer(*(getattr(wide, name)[rows, columns] for name in GBuffer.__dataclass_fields__))
