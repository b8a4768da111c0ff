"""The picture, tile by tile: see, gather, filter, shade (paper 004 §3)."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.filter import Reach, filtered, margins, windows
from lightwell.igi.gather import Gathered, Gatherer
from lightwell.igi.gbuffer import GBuffer, look, require_outside
from lightwell.igi.rendering import TILE, IgiRendering, Tile, assemble, cut
from lightwell.igi.scene import IgiScene
from lightwell.igi.shade import Responses, responses
from lightwell.igi.subpixels import ELSEWHERE, neighbours_means, own_pixels, pixel_means, strips
from lightwell.igi.surfaces import Singles, Surfaces
from lightwell.igi.virtual import make_virtual_lights
from lightwell.igi_settings import IgiSettings
from lightwell.render.camera import Camera, require_size
from lightwell.scene_settings import MAX_SAMPLES


class IgiRenderer:
    """A scene with its virtual lights, which serve any camera; immutable, for any number of threads."""

    def __init__(self, scene: IgiScene, settings: IgiSettings, surfaces: Surfaces | None = None) -> None:
        """Make the virtual lights of a scene; ``surfaces`` are those of its objects where there are some already."""
        self.settings = settings
        self.surfaces = surfaces or Surfaces(scene)
        self.lights = make_virtual_lights(scene, self.surfaces, settings)
        self._sky = scene.sky
        self._gatherer = Gatherer(self.surfaces.rays, self.lights, settings.bands, field=scene.field)
        self._groups = 2 if {"direct", "indirect"} & set(settings.layers) else 1

    def tile(
        self,
        camera: Camera,
        size: tuple[int, int],
        tile: Tile,
        check: Callable[[], None] | None = None,
        samples: int = 1,
    ) -> IgiRendering:
        """Return a tile of a picture; its pixels are the same, to the last bit, in whatever tiles that is cut.

        ``check`` is called several times a second; what it raises ends the work. ``samples`` as in `render_igi`.
        """
        settings = self.settings
        reach = margins(settings)
        rows, columns = (
            (tile.top - reach.up, tile.bottom + reach.down),
            (tile.left - reach.left, tile.right + reach.right),
        )
        wide = look(self.surfaces, camera, size, rows, columns)
        gathered = self._gatherer.gather(
            wide.place, wide.geometric, wide.seen, (columns[0], rows[0]), self._groups, check
        )
        raw = gathered.coefficients
        sums = _Sums(gathered.arrived, gathered.clamped, gathered.rays)
        if settings.filter == "sh":
            last = self._filter(raw, wide)
            inner, coefficients = last.inner, last.after
            if samples == 1:
                lit = self._lit(inner, self._receive(coefficients, inner))
            else:
                lit, more = self._by_subpixels(camera, size, tile, samples, last, check)
                sums = sums.plus(more)
        else:
            last = self._filter(np.stack(self._receive(raw, wide), axis=2), wide)
            inner, coefficients = last.inner, raw[reach.within(raw.shape)]
            lit = self._lit(inner, Responses(last.after[:, :, 0], last.after[:, :, 1]))
        wanted = set(settings.layers)
        n, m = settings.sets
        turn = np.arange(tile.left, tile.right) % n + n * (np.arange(tile.top, tile.bottom) % m)[:, None]
        return IgiRendering(
            lit.direct + lit.indirect,
            lit.behind,
            lit.coverage,
            inner.shading if "normal" in wanted else None,
            inner.depth if "depth" in wanted else None,
            lit.albedo if "albedo" in wanted else None,
            lit.direct if "direct" in wanted else None,
            lit.indirect if "indirect" in wanted else None,
            turn.astype(np.uint16) if "set" in wanted else None,
            coefficients.sum(axis=2) if "coefficients" in wanted else None,
            *sums,
        )

    def _filter(self, values: Singles, pixels: GBuffer) -> _LastPass:
        """Filter values ``(H, W, …)`` of a rectangle with margins."""
        strict = self.settings.filter == "irradiance-strict"
        found = _LastPass(pixels, Reach(0, 0, 0, 0), values, pixels, values)
        for reach in windows(self.settings):
            now, before = found.inner, found.after
            flat = before.reshape(*before.shape[:2], -1)
            means = filtered(flat, now, reach, strict)
            after = means.reshape(*means.shape[:2], *values.shape[2:])
            found = _LastPass(now, reach, before, now.part(reach.within(now.seen.shape)), after)
        return found

    def _by_subpixels(
        self,
        camera: Camera,
        size: tuple[int, int],
        tile: Tile,
        samples: int,
        centres: _LastPass,
        check: Callable[[], None] | None,
    ) -> tuple[_Lit, _Sums]:
        """Return the means over N × N rays a pixel, and what was gathered for rays on no pixel's surface."""
        parts: list[_Lit] = []
        sums = _Sums(0.0, 0.0, 0)
        for first, last in strips(tile.bottom - tile.top, tile.right - tile.left, samples):
            if check is not None:
                check()
            rows = (tile.top + first) * samples, (tile.top + last) * samples
            columns = tile.left * samples, tile.right * samples
            fine = look(self.surfaces, camera, (size[0] * samples, size[1] * samples), rows, columns)
            table, own, gathered = self._incident(fine, centres, (first, last), samples, (columns[0], rows[0]), check)
            if gathered is not None:
                sums = sums.plus(gathered)
            lit = self._lit(fine, self._respond(table, fine, own))
            parts.append(_Lit(*(pixel_means(layer, samples) for layer in lit)))
        return _Lit(*(np.concatenate(layers) for layers in zip(*parts, strict=True))), sums

    def _incident(
        self,
        fine: GBuffer,
        centres: _LastPass,
        rows: tuple[int, int],
        samples: int,
        corner: tuple[int, int],
        check: Callable[[], None] | None,
    ) -> tuple[Singles, NDArray[np.int64], Gathered | None]:
        """Return coefficients ``(K, G, bands², 3)``, which of them each ray takes, and what was gathered for some.

        ``fine``: what the rays of rows ``rows[0] … rows[1] − 1`` of the pixels see; ``corner``: column and row of the
        first of these rays.
        """
        pixels = centres.inner.part(np.s_[rows[0] : rows[1], :])
        own = own_pixels(fine, pixels, samples)
        elsewhere = np.flatnonzero(own == ELSEWHERE)
        before = centres.before.reshape(*centres.before.shape[:2], -1)
        means, found = neighbours_means(before, centres.pixels, fine, elsewhere, samples, centres.reach, rows[0])
        gathered = None
        if not found.all():
            alone = np.zeros(fine.seen.size, np.bool_)
            alone[elsewhere[~found]] = True
            chosen = alone.reshape(fine.seen.shape)
            gathered = self._gatherer.gather(fine.place, fine.geometric, chosen, corner, self._groups, check)
            means[~found] = gathered.coefficients.reshape(fine.seen.size, -1)[elsewhere[~found]]
        table = centres.after[rows[0] : rows[1]].reshape(-1, *centres.after.shape[2:])
        own[elsewhere] = len(table) + np.arange(len(elsewhere))
        return np.concatenate([table, means.reshape(len(means), *table.shape[1:])]), own, gathered

    def _receive(self, coefficients: Singles, seen: GBuffer) -> Responses:
        """Return what surfaces get, ``(H, W, G, 3)``, of coefficients ``(H, W, G, bands², 3)``; zero where none is."""
        # Pixels without a surface have no coefficients and no lobe.
        return self._respond(coefficients.reshape(seen.seen.size, *coefficients.shape[2:]), seen, None)

    def _respond(self, table: Singles, seen: GBuffer, rows: NDArray[np.int64] | None) -> Responses:
        """Return what surfaces get, ``(H, W, G, 3)``; ``table`` and ``rows`` as in `lightwell.igi.shade.respond`."""
        count = seen.seen.size
        matte, lobe = responses(
            table,
            seen.shading.reshape(count, 3),
            seen.view.reshape(count, 3),
            seen.geometric.reshape(count, 3),
            seen.exponent.reshape(count),
            np.asarray(seen.ks.reshape(count, 3).max(axis=1) > 0),
            self.settings.kernel,
            self.settings.bands,
            rows,
        )
        shape = (*seen.seen.shape, table.shape[1], 3)
        return Responses(matte.reshape(shape), lobe.reshape(shape))

    def _lit(self, seen: GBuffer, received: Responses) -> _Lit:
        """Return what goes to the eye."""
        reflected = seen.kd[:, :, None] * received.matte + seen.ks[:, :, None] * received.lobe
        behind = np.zeros_like(seen.emission)
        if self._sky is not None and not seen.seen.all():
            behind[~seen.seen] = self._sky.radiance(seen.view[~seen.seen].astype(np.float64))
        indirect = reflected[:, :, 1] if self._groups == 2 else np.zeros_like(behind)
        direct = seen.emission + reflected[:, :, 0]
        return _Lit(direct, indirect, behind, seen.seen.astype(np.float32), seen.kd + seen.ks)


class _Lit(NamedTuple):
    """Radiance that goes to the eye, and what has its means over rays besides; as in `IgiRendering`."""

    direct: Singles
    indirect: Singles
    behind: Singles
    coverage: Singles
    albedo: Singles


class _LastPass(NamedTuple):
    """What the last pass of the filter makes of what the centres of pixels get."""

    pixels: GBuffer
    """What they see, with the margins of this pass."""
    reach: Reach
    before: Singles
    """``(H, W, …)``, with those margins."""
    inner: GBuffer
    """Without them."""
    after: Singles
    """``(H', W', …)``, without them."""


class _Sums(NamedTuple):
    """As in `IgiRendering`."""

    arrived: float
    clamped: float
    rays: int

    def plus(self, more: Gathered | _Sums) -> _Sums:
        return _Sums(self.arrived + more.arrived, self.clamped + more.clamped, self.rays + more.rays)


def render_igi(
    scene: IgiScene,
    camera: Camera,
    size: tuple[int, int],
    settings: IgiSettings,
    progress: Callable[[int, int], None] | None = None,
    check: Callable[[], None] | None = None,
    tile: int = TILE,
    threads: int | None = None,
    samples: int = 1,
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
        Called several times a second, from any thread; what it raises ends the work.
    tile
        Pixels along each side of a tile: more take more memory and do less work twice.
    threads
        How many work at once; by default as many as there are cores.
    samples
        N: a pixel is the mean of N² rays, which share the incident radiance of its centre (`lightwell.igi.subpixels`);
        with another filter than ``sh`` a pixel is one ray.

    Raises
    ------
    ValueError
        Where the size or ``samples`` is out of range, or ``samples`` and the filter do not go together.
    RenderError
        Where the camera stands inside an object.
    """
    require_size(size)
    if tile < 1:
        raise ValueError(f"tile = {tile} must be at least 1")
    if not 1 <= samples <= MAX_SAMPLES:
        raise ValueError(f"samples = {samples} must lie between 1 and {MAX_SAMPLES}")
    if samples > 1 and settings.filter != "sh":
        raise ValueError(f"samples = {samples} needs filter = 'sh': with {settings.filter!r} a pixel is one ray")
    renderer = IgiRenderer(scene, settings)
    require_outside(renderer.surfaces, camera)
    tiles = cut(size, tile)
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        waiting = deque(pool.submit(renderer.tile, camera, size, one, check, samples) for one in tiles)

        def finished() -> Iterator[tuple[Tile, IgiRendering]]:
            for done, one in enumerate(tiles, 1):
                # Tiles are let go of when they are in the picture, which would else be in memory twice.
                yield one, waiting.popleft().result()
                if progress is not None:
                    progress(done, len(tiles))

        try:
            return assemble(size, finished())
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
