"""The page's picture against `lightwell.render` (issue 4, Done-when 3), and what a user sees of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect
from tests.browser.conftest import OpenPage
from tests.browser.pictures import Picture, decode, see_until, settled
from tests.browser.publisher import CAP, K, Publisher, distant_light, log_jpeg
from tests.browser.results import lit_and_dark, put_grid, put_group
from tests.browser.server import ServerProcess
from tests.support.reference_pictures import encode_as_page, page_picture, page_scene

from lightwell.field.grid import Grid
from lightwell.probe.latlong import LatLong
from lightwell.render import FieldLight, Panorama, Scene
from lightwell.render.light import modulate

pytestmark = [pytest.mark.browser, pytest.mark.timeout(180)]

CAMERA = (0.9, -5.2, 1.9, 0.12, -0.08, 0.5)
SIZE = (720, 440)
BARE = "stream=room&panel=0&hud=0&backdrop=off&theme=dark&camera=" + ",".join(map(str, CAMERA))
ARTEFACTS = Path(__file__).parents[2] / ".artefacts"
FULL_SCALE = 255.0


def keep(picture: Picture, name: str) -> None:
    """Keep a picture for whoever wants to look at it."""
    ARTEFACTS.mkdir(exist_ok=True)
    cv2.imwrite(str(ARTEFACTS / f"{name}.png"), picture[..., ::-1].round().astype(np.uint8))


def compare(page: Page, expected: Picture, name: str) -> float:
    """Return the mean difference over the object (what is not black in the picture expected), of full scale."""
    # Whatever lies over the picture: only the picture is compared.
    page.add_style_tag(content=".panel, .notice, .hud, .message { display: none !important }")
    # At edges two kinds of antialiasing would be compared.
    inside = cv2.erode((expected.sum(axis=-1) > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert inside.mean() > 0.05

    def differ(picture: Picture) -> float:
        return float(np.abs(picture - expected)[inside].mean() / FULL_SCALE)

    seen = see_until(page, lambda picture: differ(picture) < 0.01)
    keep(np.concatenate([seen, expected], axis=1), name)
    difference = differ(seen)
    with (ARTEFACTS / "figures.txt").open("a", encoding="utf-8") as figures:
        figures.write(f"{name}: mean difference {100 * difference:.3f} % of full scale\n")
    return difference


@pytest.mark.parametrize(
    ("name", "hash_", "view"),
    [
        ("diffuse", "shadows=0&gloss=0", {"shadows": False, "gloss": 0.0}),
        ("phong", "shadows=0&gloss=0.7&exponent=6", {"shadows": False, "gloss": 0.7, "exponent": 6.0}),
        ("prt", "shadows=1&gloss=0", {"shadows": True, "gloss": 0.0}),
        ("prt-phong-3-bands", "gloss=0.5&exponent=9&bands=3", {"gloss": 0.5, "exponent": 9.0, "bands": 3}),
    ],
)
def test_the_picture_agrees_with_python(
    open_page: OpenPage, room: Publisher, name: str, hash_: str, view: dict[str, Any]
) -> None:
    room.coefficients = distant_light((-1.0, -0.6, 0.8)) * [1.0, 0.8, 0.5] + 0.3 * distant_light((1.0, 0.2, 0.1))
    page = open_page(f"#{BARE}&ev=-1&{hash_}", size={"width": SIZE[0], "height": SIZE[1]})
    expected = page_picture(room.coefficients, CAMERA, SIZE, ev=-1.0, **view)
    difference = compare(page, expected, f"render-{name}")
    assert difference < 0.01


# What `viewport.ts` does with the still life in a grid: its middle there, and this size.
MIDDLE, RADIUS = np.array([0.12, -0.08, 0.5]), 1.82
SIZE_IN_GRID = 0.26


def in_grid(scene: Scene, grid: Grid, at: Sequence[float]) -> Scene:
    """Put the still life into the grid, as the page does."""
    edges = np.subtract(grid.spec.upper, grid.spec.lower)
    scale = SIZE_IN_GRID * max(edges.min(), 0.5 * edges.max()) / RADIUS
    moved = tuple(
        replace(
            item, mesh=replace(item.mesh, positions=((item.mesh.positions - MIDDLE) * scale + at).astype(np.float32))
        )
        for item in scene.objects
    )
    return replace(scene, objects=moved)


@pytest.fixture(scope="module")
def grid(server: ServerProcess) -> tuple[str, Grid]:
    """A finished grid that is bright on the left and dark on the right."""
    return put_grid(server, "lit-and-dark", lit_and_dark())


GRID_CAMERA = (0.3, -1.7, 1.0, -0.3, 0.0, 0.55)
GRID_BARE = "stream=room&panel=0&hud=0&backdrop=off&theme=dark&probes=0&light=grid"


@pytest.mark.parametrize("sampling", ["fragment", "vertex"])
@pytest.mark.parametrize(("shadows", "gloss"), [(0, 0.0), (1, 0.5)])
def test_the_picture_in_a_grid_agrees_with_python(
    open_page: OpenPage, room: Publisher, grid: tuple[str, Grid], sampling: str, shadows: int, gloss: float
) -> None:
    name, field = grid
    at = (-0.3, 0.1, 0.55)
    camera = ",".join(map(str, GRID_CAMERA))
    hash_ = f"#{GRID_BARE}&grid={name}&at={at[0]},{at[1]},{at[2]}&camera={camera}&ev=0"
    hash_ += f"&sampling={sampling}&shadows={shadows}&gloss={gloss}&exponent=6"
    page = open_page(hash_, size={"width": SIZE[0], "height": SIZE[1]})
    scene = page_scene(
        FieldLight(field),
        gloss=gloss,
        exponent=6.0,
        shadows=bool(shadows),
        sampling="point" if sampling == "fragment" else "vertex",
    )
    expected = encode_as_page(in_grid(scene, field, at), GRID_CAMERA, SIZE, ev=0.0)
    difference = compare(page, expected, f"render-grid-{sampling}-{'prt-phong' if gloss else 'diffuse'}")
    assert difference < 0.01


def test_the_picture_in_a_grid_that_the_live_light_changes_agrees_with_python(
    open_page: OpenPage, room: Publisher, grid: tuple[str, Grid]
) -> None:
    name, field = grid
    at = (-0.3, 0.1, 0.55)
    here = field.sample((0.0, 0.0, 0.6)).coefficients
    room.coefficients = 0.6 * here + 0.2 * distant_light((0.8, -0.5, 0.3))
    camera = ",".join(map(str, GRID_CAMERA))
    hash_ = f"#{GRID_BARE}&grid={name}&at={at[0]},{at[1]},{at[2]}&camera={camera}&ev=0&sampling=fragment&gloss=0.3"
    page = open_page(hash_.replace("light=grid", "light=both"), size={"width": SIZE[0], "height": SIZE[1]})
    changed = modulate(FieldLight(field), room.coefficients)
    assert 0.05 < changed.residual < 0.9
    scene = page_scene(FieldLight(field), gloss=0.3)
    expected = encode_as_page(in_grid(replace(scene, light=changed), field, at), GRID_CAMERA, SIZE, ev=0.0)
    assert compare(page, expected, "render-grid-and-live") < 0.01


def test_the_mirrored_harmonics_agree_with_python(open_page: OpenPage, room: Publisher) -> None:
    room.coefficients = distant_light((-1.0, -0.6, 0.8)) * [1.0, 0.8, 0.5] + 0.3 * distant_light((1.0, 0.2, 0.1))
    hash_ = f"#{BARE}&ev=-1&mirror=0.6&gloss=0".replace("backdrop=off", "backdrop=harmonics")
    page = open_page(hash_, size={"width": SIZE[0], "height": SIZE[1]})
    expected = page_picture(room.coefficients, CAMERA, SIZE, ev=-1.0, mirror=0.6, gloss=0.0, backdrop=True)
    assert compare(page, expected, "render-mirror") < 0.01


@dataclass(frozen=True, eq=False)
class SentPicture:
    """The backdrop as the page has it: the JPEG of a curve, interpolated before the curve is undone."""

    curve: Panorama

    @classmethod
    def of(cls, radiance: NDArray[np.float64]) -> SentPicture:
        return cls(Panorama(decode(log_jpeg(radiance)) / 255, "cubic"))

    def radiance(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((np.exp2(self.curve.radiance(directions) * np.log2(1 + K * CAP)) - 1) / K)


def test_the_mirrored_picture_agrees_with_python(open_page: OpenPage, room: Publisher) -> None:
    """Equation 15 of paper 003: the backdrop's picture in the mirror direction, with its weight."""
    room.coefficients = distant_light((-1.0, -0.6, 0.8)) * [1.0, 0.8, 0.5] + 0.3 * distant_light((1.0, 0.2, 0.1))
    directions, _ = LatLong(32, 64).directions(np.arange(64) + 0.5, np.arange(32)[:, None] + 0.5)
    lamps = sum(
        np.exp(24 * (directions @ (np.array(place) / np.linalg.norm(place)) - 1))[..., None] * colour
        for place, colour in [((-1, -1, 0.8), (6, 4, 2)), ((1, -0.6, 0.1), (0.5, 1, 3)), ((0.2, 1, 1), (1, 3, 1))]
    )
    room.backdrop = 0.1 + 0.3 * np.maximum(directions[..., 2:], 0) + lamps
    hash_ = f"#{BARE}&ev=-1&mirror=0.7&gloss=0.2&exponent=6"
    page = open_page(hash_, size={"width": SIZE[0], "height": SIZE[1]})
    scene = page_scene(room.coefficients, mirror=0.7, gloss=0.2, exponent=6.0)
    # Behind the objects nothing is shown: what the mirrors show is taken away there.
    picture = encode_as_page(replace(scene, backdrop=SentPicture.of(room.backdrop)), CAMERA, SIZE, ev=-1.0)
    plain = encode_as_page(scene, CAMERA, SIZE, ev=-1.0)
    expected = np.where(plain.sum(axis=-1, keepdims=True) > 0, picture, 0)
    assert np.abs(expected - plain)[plain.sum(axis=-1) > 0].mean() > 0.03 * FULL_SCALE, "the mirror is to be seen"
    assert compare(page, expected, "render-mirrored-picture") < 0.01


def middle(picture: Picture) -> float:
    """Return the brightness of what is in the middle of the picture."""
    height, width, _ = picture.shape
    return float(picture[height * 2 // 5 : height * 3 // 5, width * 2 // 5 : width * 3 // 5].mean())


def test_an_object_that_moves_into_the_dark_gets_darker_as_the_grid_says(
    open_page: OpenPage, room: Publisher, grid: tuple[str, Grid]
) -> None:
    name, field = grid
    lit, dark = np.array([-0.75, 0.0, 0.6]), np.array([0.75, 0.0, 0.6])
    # The light falls off alike in all coefficients, so one factor says by how much.
    both = field.sample(np.stack([lit, dark])).coefficients[:, 0].sum(axis=-1)
    factor = float(both[0] / both[1])
    assert 3 < factor < 6

    def look(at: NDArray[np.float64], ev: float) -> str:
        camera = ",".join(f"{value:.3f}" for value in [*np.add(at, (0.3, -1.4, 0.45)), *at])
        place = ",".join(f"{value:.3f}" for value in at)
        where = f"grid={name}&at={place}&camera={camera}&ev={ev:.3f}"
        return f"#{GRID_BARE}&{where}&object=bunny&gloss=0&sampling=fragment"

    page = open_page(look(lit, 0.5), size={"width": SIZE[0], "height": SIZE[1]})
    page.add_style_tag(content=".panel, .notice, .hud, .message { display: none !important }")
    # A busy machine takes long to compile the first shader: `see_until` alone may give up too soon.
    for _ in range(3):
        # Without the object, before it has come, the page is half as bright.
        if middle(see_until(page, lambda picture: middle(picture) > 70)) > 70:
            break
    bright = settled(page)
    keep(bright, "grid-object-lit")

    # By keys, as a user would: 0.05 of the box's 3 m with each.
    page.locator("canvas").first.focus()
    for _ in range(10):
        page.keyboard.press("m")
    page.wait_for_function("/at=0?\\.75,0,0\\.6/.test(location.hash)")
    page.evaluate(f"location.hash = {look(dark, 0.5)!r}")
    see_until(page, lambda picture: middle(picture) < 0.7 * middle(bright))
    darker = settled(page)
    keep(darker, "grid-object-dark")
    page.evaluate(f"location.hash = {look(dark, 0.5 + np.log2(factor))!r}")
    exposed = see_until(page, lambda picture: abs(middle(picture) / middle(bright) - 1) < 0.02)
    keep(exposed, "grid-object-dark-exposed")
    # Exposed by the factor more, it looks as it did.
    assert middle(darker) < 0.7 * middle(bright)
    assert middle(exposed) == pytest.approx(middle(bright), rel=0.02)


def test_a_grid_that_cannot_be_drawn_is_refused_in_words(
    open_page: OpenPage, room: Publisher, server: ServerProcess
) -> None:
    name = put_group(server, "no-grid-job", {"format": "somebody.elses.v2"})
    page = open_page(f"#stream=room&grid={name}&light=grid", size={"width": 900, "height": 600})
    expect(page.get_by_text("This is no grid")).to_be_visible()


def test_grids_and_probes_look_well(open_page: OpenPage, room: Publisher, grid: tuple[str, Grid]) -> None:
    """Nothing but a picture to look at, and a console that stays empty."""
    name, _ = grid
    looks = {
        "grid": "light=grid",
        "both": "light=both&object=sphere&mirror=0.3",
        "gizmo": "light=grid&gizmo=1",
    }
    for title, more in looks.items():
        page = open_page(f"#stream=room&panel=0&grid={name}&{more}", size={"width": 800, "height": 600})
        expect(page.get_by_test_id("badge")).to_have_text("Grid × live" if "both" in more else "Grid")
        picture = settled(page)
        keep(picture, f"look-{title}")
        assert picture.std() > 10


def test_the_handles_move_the_object_and_keep_it_in_the_box(
    open_page: OpenPage, room: Publisher, grid: tuple[str, Grid]
) -> None:
    name, _ = grid
    page = open_page(f"#{GRID_BARE}&grid={name}&at=0,0,0.6&gizmo=1", size={"width": 800, "height": 600})

    def red(picture: Picture) -> NDArray[np.int64]:
        """Rows and columns of the handle along x."""
        return np.argwhere((picture[..., 0] > 200) & (picture[..., 1:].max(axis=-1) < 60))

    picture = see_until(page, lambda seen: len(red(seen)) > 40)
    row, column = red(picture)[red(picture)[:, 1].argmax()]
    page.mouse.move(int(column) - 4, int(row))
    page.mouse.down()
    page.mouse.move(int(column) + 60, int(row), steps=4)
    page.mouse.up()
    page.wait_for_function("/at=[^0&-][^,]*,|at=0[.][^,]*,/.test(location.hash)")
    x, y, z = map(float, page.evaluate("location.hash.match(/at=([^&]*)/)[1].split(',')"))
    assert x > 0.05
    assert (y, z) == pytest.approx((0.0, 0.6), abs=0.01)
    assert "camera=" not in page.evaluate("location.hash"), "the camera does not turn meanwhile"
    keep(settled(page), "grid-handles")
    # Beyond the box it does not go.
    page.locator("canvas").first.focus()
    for _ in range(24):
        page.keyboard.press("i")
    page.wait_for_function("location.hash.match(/at=([^&]*)/)[1].split(',')[2] === '1.2'")


def test_the_picture_comes_back_after_the_graphics_were_lost(
    open_page: OpenPage, room: Publisher, grid: tuple[str, Grid], console: list[str]
) -> None:
    name, _ = grid
    with_probes = GRID_BARE.replace("probes=0", "probes=1")
    page = open_page(f"#{with_probes}&grid={name}&ev=0", size={"width": 800, "height": 600})
    expect(page.get_by_test_id("badge")).to_have_text("Grid")
    see_until(page, lambda picture: picture.std() > 10)
    before = settled(page)
    graphics = "document.querySelector('canvas').getContext('webgl2')"
    page.evaluate(f"window.lost = {graphics}.getExtension('WEBGL_lose_context'); undefined")
    page.evaluate("window.lost.loseContext()")
    page.wait_for_timeout(300)
    page.evaluate("window.lost.restoreContext()")
    again = see_until(page, lambda picture: bool(np.abs(picture - before).mean() < 1))
    assert np.abs(again - before).mean() < 1
    # Three says that, and nothing else is said.
    assert all("Context" in line for line in console), console
    console.clear()
