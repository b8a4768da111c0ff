"""Grids of all forms in the page, against `lightwell.render`: adaptive, with gradients, and several as light groups."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from tests.browser.conftest import OpenPage
from tests.browser.pictures import Picture, see
from tests.browser.publisher import Publisher, distant_light
from tests.browser.results import put_adaptive, put_grid
from tests.browser.server import ServerProcess
from tests.browser.test_render import FULL_SCALE, GRID_BARE, GRID_CAMERA, SIZE, compare, in_grid, keep
from tests.support.reference_pictures import encode_as_page, page_scene

from lightwell.field.adapt import adapt
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.render import FieldLight, Light, SummedLight, modulate
from lightwell.render.scene import Sampling

pytestmark = [pytest.mark.browser, pytest.mark.timeout(180)]

AT = (-0.3, 0.1, 0.55)
PROBE = (0.6, -0.4, 0.7)


def look(
    open_page: OpenPage, name: str, sampling: Sampling, more: str = "", *, light: str = "grid", panel: bool = False
) -> Page:
    """Open the page with the still life in a grid."""
    hash_ = f"#{GRID_BARE}&grid={name}&at={','.join(map(str, AT))}&camera={','.join(map(str, GRID_CAMERA))}&ev=0"
    hash_ = hash_.replace("light=grid", f"light={light}").replace("panel=0", f"panel={int(panel)}")
    hash_ += f"&sampling={'fragment' if sampling == 'point' else 'vertex'}&gloss=0.4&exponent=6{more}"
    return open_page(hash_, size={"width": SIZE[0], "height": SIZE[1]})


def expected_picture(light: Light, grid: Grid, sampling: Sampling, *, shadows: bool = True) -> Picture:
    """What Python makes of it; ``grid`` is the one whose box is shown."""
    scene = page_scene(FieldLight(grid), gloss=0.4, exponent=6.0, shadows=shadows, sampling=sampling)
    return encode_as_page(in_grid(replace(scene, light=light), grid, AT), GRID_CAMERA, SIZE, ev=0.0)


def lamp(spec: GridSpec, side: float, colour: tuple[float, float, float]) -> Grid:
    """A field that is bright at one end of x, lit from there."""
    x = spec.centres()[..., 0]
    brightness = np.exp(-1.1 * (1.5 - side * x))[..., None, None]
    coefficients = brightness * distant_light((side, -0.6, 0.7)) * np.array(colour)
    return Grid(spec, np.asarray(coefficients, np.float32), np.ones(spec.shape, np.float32))


@pytest.fixture(scope="module")
def lamps(server: ServerProcess) -> list[tuple[str, Grid]]:
    """Two captures of one room, a lamp each; their cells differ."""
    box = ((-1.5, -1.0, 0.0), (1.5, 1.0, 1.2))
    warm = lamp(GridSpec(*box, (12, 10, 6)), -1.0, (1.0, 0.7, 0.4))
    cold = lamp(GridSpec(*box, (7, 5, 4)), 1.0, (0.4, 0.7, 1.0))
    return [put_grid(server, "warm-lamp", warm), put_grid(server, "cold-lamp", cold)]


def bump() -> Grid:
    """Dim and even, with a spot of light that takes small bricks."""
    spec = GridSpec((-1.5, -1.0, 0.0), (1.5, 1.0, 1.2), (21, 18, 11))
    x, y, z = np.moveaxis(spec.centres(), -1, 0)
    spot = np.exp(-9 * ((x + 0.5) ** 2 + y**2 + (z - 0.5) ** 2))[..., None, None]
    values = 0.4 * distant_light((0.3, -0.4, 1.0)) + 2 * spot * distant_light((-0.6, -0.8, 0.2)) * [1.0, 0.7, 0.4]
    return Grid(spec, values.astype(np.float32), np.ones(spec.shape, np.float32))


@pytest.mark.parametrize("sampling", ["point", "vertex"])
def test_an_adaptive_grid_is_drawn_as_python_draws_it(
    open_page: OpenPage, room: Publisher, server: ServerProcess, sampling: Sampling
) -> None:
    name, grid = put_adaptive(server, f"adaptive-{sampling}", adapt(bump(), 0.05))
    assert sum(count > 0 for count in grid.leaves) > 1, "of more than one size"
    page = look(open_page, name, sampling)
    expected = expected_picture(FieldLight(grid), grid.to_regular(), sampling)
    assert compare(page, expected, f"render-adaptive-{sampling}") < 0.01


def curved() -> Grid:
    """A coarse grid of a light that falls off within less than a cell, with its gradients."""
    spec = GridSpec((-1.5, -1.0, 0.0), (1.5, 1.0, 1.2), (5, 4, 3))
    x, y, z = np.moveaxis(spec.centres(), -1, 0)
    brightness = 3.0 * np.exp(-2.2 * ((x + 0.15) ** 2 + (y - 0.2) ** 2 + (z - 0.6) ** 2))[..., None, None]
    values = (brightness * distant_light((0.3, -0.8, 0.6)) * [1.0, 0.8, 0.6]).astype(np.float32)
    falls = [-4.4 * (x + 0.15), -4.4 * (y - 0.2), -4.4 * (z - 0.6)]
    gradients = np.stack([values * fall[..., None, None].astype(np.float32) for fall in falls], axis=-1)
    return Grid(spec, values, np.ones(spec.shape, np.float32), None, gradients)


@pytest.mark.parametrize("sampling", ["point", "vertex"])
def test_a_grid_with_gradients_is_drawn_by_the_half_gradient_rule(
    open_page: OpenPage, room: Publisher, server: ServerProcess, sampling: Sampling
) -> None:
    name, grid = put_grid(server, f"curved-{sampling}", curved())
    bent = expected_picture(FieldLight(grid), grid, sampling)
    straight = expected_picture(FieldLight(replace(grid, gradients=None)), grid, sampling)
    lit = straight.sum(axis=-1) > 0
    assert np.abs(bent - straight)[lit].mean() > 0.02 * FULL_SCALE, "the rule is to be seen"
    page = look(open_page, name, sampling, panel=True)
    page.get_by_role("switch", name="Gradients").uncheck()
    page.wait_for_function("location.hash.includes('gradients=0')")
    without = look(open_page, name, sampling, "&gradients=0")
    assert compare(without, straight, f"render-straight-{sampling}") < 0.01
    assert compare(look(open_page, name, sampling), bent, f"render-gradients-{sampling}") < 0.01


@pytest.mark.parametrize("sampling", ["point", "vertex"])
def test_light_groups_follow_the_live_light_as_python_has_it(
    open_page: OpenPage, room: Publisher, lamps: list[tuple[str, Grid]], sampling: Sampling
) -> None:
    (warm_name, warm), (cold_name, cold) = lamps
    fields = [FieldLight(warm), FieldLight(cold)]
    at_probe = [field.at(np.array([PROBE]))[0] for field in fields]
    room.coefficients = 0.2 * at_probe[0] + 1.6 * at_probe[1]
    page = look(
        open_page,
        warm_name,
        sampling,
        f"&groups={cold_name}&probeAt={','.join(map(str, PROBE))}",
        light="both",
    )
    light = modulate(fields, room.coefficients, PROBE)
    assert light.method == "groups"
    assert compare(page, expected_picture(light, warm, sampling), f"render-groups-{sampling}") < 0.01


def test_light_groups_without_the_live_light_add_up(
    open_page: OpenPage, room: Publisher, lamps: list[tuple[str, Grid]]
) -> None:
    (warm_name, warm), (cold_name, cold) = lamps
    page = look(open_page, warm_name, "point", f"&groups={cold_name}")
    light = SummedLight((FieldLight(warm), FieldLight(cold)))
    assert compare(page, expected_picture(light, warm, "point"), "render-groups-sum") < 0.01


def facts(page: Page) -> dict[str, str]:
    """What the page says of how the live light changes the grids."""
    text = page.get_by_test_id("modulation")
    return dict(zip(text.locator("dt").all_inner_texts(), text.locator("dd").all_inner_texts(), strict=True))


def test_a_user_adds_a_light_group_and_sees_what_each_lamp_does(
    open_page: OpenPage, room: Publisher, lamps: list[tuple[str, Grid]]
) -> None:
    (warm_name, warm), (cold_name, cold) = lamps
    at_probe = [FieldLight(grid).at(np.array([PROBE]))[0] for grid in (warm, cold)]
    room.coefficients = 0.5 * at_probe[0] + 2.0 * at_probe[1]
    page = open_page(f"#stream=room&light=both&grid={warm_name}&panel=1", size={"width": 900, "height": 900})
    # Where the probe stands nobody has said: the user does.
    for axis, value in zip("xyz", PROBE, strict=True):
        field = page.get_by_label(f"Live probe, {axis} in metres")
        field.fill(str(value))
        field.press("Tab")
    page.wait_for_function("location.hash.includes('probeAt=0.6,-0.4,0.7')")
    page.get_by_label("Add a light group").select_option(cold_name)
    expect(page.get_by_test_id("modulation")).to_contain_text("each group has its gain")
    page.wait_for_function(f"location.hash.includes('groups={cold_name}')")
    seen = facts(page)
    gains = [[float(value) for value in seen[name].split()] for name in (warm_name, cold_name)]
    np.testing.assert_allclose(gains, [[0.5] * 3, [2.0] * 3], rtol=0.01)
    assert re.match(r"0\.\d %, left out", seen["Unexplained"])
    keep(see(page), "groups-panel")
    # A lamp that no grid knows: neither of them is turned up for it.
    room.coefficients = room.coefficients + 0.5 * distant_light((0.1, 1.0, -0.4))
    expect(page.get_by_test_id("modulation")).to_contain_text("one gain for all")
    expect(page.get_by_test_id("modulation")).to_contain_text("added as distant light")
    page.get_by_role("button", name="Remove").click()
    expect(page.get_by_test_id("group")).to_have_count(0)
    page.wait_for_function("!location.hash.includes('groups=')")
    # The same from the list of grids.
    page.get_by_role("tab", name="Grids").click()
    card = page.get_by_test_id("grid").filter(has_text=cold_name)
    card.get_by_role("button", name="Add as light group").click()
    expect(card.get_by_text("light group", exact=True)).to_be_visible()


def test_where_the_stream_says_that_its_probe_stands_is_where_it_is_compared(
    open_page: OpenPage, room: Publisher, server: ServerProcess, lamps: list[tuple[str, Grid]]
) -> None:
    (warm_name, warm), _ = lamps
    with Publisher(server.url, "placed", position_m=list(PROBE)) as placed:
        placed.coefficients = 0.25 * FieldLight(warm).at(np.array([PROBE]))[0]
        page = open_page(
            f"#stream=placed&light=both&grid={warm_name}&panel=1&probeAt=1,0,0", size={"width": 900, "height": 900}
        )
        expect(page.get_by_test_id("probe-at")).to_have_text("0.6, -0.4, 0.7 m")
        expect(page.get_by_label("Live probe, x in metres")).to_have_count(0)
        expect(page.get_by_test_id("modulation")).to_contain_text("0.250 0.250 0.250")
        expect(page.get_by_test_id("modulation")).to_contain_text("left out")
