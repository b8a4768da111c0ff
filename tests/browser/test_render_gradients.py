"""Streams with gradients and fields of streams in the page, against `lightwell.render` (issue 5, Done-when 5)."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, ViewportSize, expect
from tests.browser.conftest import OpenPage
from tests.browser.files import keep as keep_page
from tests.browser.pictures import Picture, see_until, settled
from tests.browser.publisher import BANDS, Publisher
from tests.browser.server import ServerProcess
from tests.browser.test_render import FULL_SCALE, MIDDLE, RADIUS, SIZE, compare
from tests.support.reference_pictures import encode_as_page, page_scene

from lightwell.conventions import degree_of_index
from lightwell.gradients.interpolate import SampleSet
from lightwell.io.scenes import load_scene, scene_settings
from lightwell.render import DistantLight, Light, SampledLight
from lightwell.sh.basis import basis_gradients, evaluate
from lightwell_client.rendering import ServerSources

pytestmark = [pytest.mark.browser, pytest.mark.timeout(240)]

LAMP, COLOUR = np.array([0.1, -0.5, 1.3]), np.array([1.0, 0.8, 0.6])
PROBE = (0.0, 0.1, 0.5)
AT = (0.14, -0.02, 0.56)
OBJECT_RADIUS = 0.25
CAMERA = (0.28, -0.85, 0.78, *AT)
LEFT, RIGHT = (-0.4, 0.0, 0.5), (0.45, 0.1, 0.55)
PANEL: ViewportSize = {"width": 1000, "height": 900}

Seen = tuple[NDArray[np.float64], NDArray[np.float64]]


def lit_by_a_lamp(place: tuple[float, float, float]) -> Seen:
    """What a probe sees of a lamp and a dim surround: coefficients (25, 3) and gradients (25, 3, 3), windowed alike."""
    s = LAMP - place
    r = float(np.linalg.norm(s))
    y, slope = evaluate(s / r, BANDS), basis_gradients(s / r, BANDS)
    softened = 1 / (1 + degree_of_index(BANDS) ** 2 / 8)
    coefficients = 2.2 * softened[:, None] * y[:, None] / r**2 * COLOUR
    coefficients[0] += 0.2 * np.sqrt(4 * np.pi)
    # MATHS §7.4: G = (I/r³)(2y ω − ∇_S y).
    slopes = 2.2 * softened[:, None] * (2 * y[:, None] * s / r - slope) / r**3
    return coefficients, slopes[:, None, :] * COLOUR[:, None]


def show(publisher: Publisher, place: tuple[float, float, float], trust: float = 0.3) -> Seen:
    publisher.coefficients, publisher.gradients = seen = lit_by_a_lamp(place)
    publisher.position, publisher.trust_radius_m = place, trust
    return seen


@pytest.fixture(scope="module")
def probe(server: ServerProcess) -> Iterator[Publisher]:
    """A stream with gradients that says where its probe stands."""
    with Publisher(server.url, "probe") as publisher:
        show(publisher, PROBE)
        yield publisher


@pytest.fixture(scope="module")
def stage(server: ServerProcess) -> Iterator[SampleSet]:
    """A field of two streams, and what it is."""
    with ExitStack() as stack:
        seen = []
        for name, place in (("left", LEFT), ("right", RIGHT)):
            publisher = Publisher(server.url, name, position_m=list(place))
            seen.append(show(publisher, place))
            stack.enter_context(publisher)
        for _ in range(100):
            made = httpx.post(f"{server.url}/api/v1/fields", json={"name": "stage", "streams": ["left", "right"]})
            if made.status_code == httpx.codes.CREATED:
                break
            time.sleep(0.1)  # the streams have not been announced yet
        made.raise_for_status()
        yield SampleSet([LEFT, RIGHT], [one for one, _ in seen], [slopes for _, slopes in seen])


def look(open_page: OpenPage, more: str, *, size: ViewportSize | None = None) -> Page:
    bare = f"#panel=0&hud=0&backdrop=off&theme=dark&probes=0&ev=0&radius={OBJECT_RADIUS}"
    place, camera = (",".join(map(str, numbers)) for numbers in (AT, CAMERA))
    return open_page(f"{bare}&at={place}&camera={camera}&{more}", size=size or {"width": SIZE[0], "height": SIZE[1]})


def expected(light: Light, *, gloss: float, shadows: bool, mirror: float = 0.0) -> Picture:
    scene = page_scene(np.zeros((25, 3)), gloss=gloss, exponent=6.0, shadows=shadows, mirror=mirror)
    scale = OBJECT_RADIUS / RADIUS
    objects = tuple(
        replace(
            item, mesh=replace(item.mesh, positions=((item.mesh.positions - MIDDLE) * scale + AT).astype(np.float32))
        )
        for item in scene.objects
    )
    return encode_as_page(replace(scene, objects=objects, light=light), CAMERA, SIZE, ev=0.0)


LOOKS = [
    ("diffuse", 0.0, False, "fragment"),
    ("phong", 0.6, False, "vertex"),
    ("prt-phong", 0.5, True, "fragment"),
    ("prt-phong", 0.5, True, "vertex"),
]


@pytest.mark.parametrize(("name", "gloss", "shadows", "sampling"), LOOKS[:3])
def test_the_picture_beside_a_probe_agrees_with_python(
    open_page: OpenPage, probe: Publisher, name: str, gloss: float, shadows: bool, sampling: str
) -> None:
    coefficients, gradients = lit_by_a_lamp(PROBE)
    light = SampledLight(SampleSet([PROBE], [coefficients], [gradients]))
    picture = expected(light, gloss=gloss, shadows=shadows)
    view = f"stream=probe&shadows={int(shadows)}&gloss={gloss}&exponent=6&sampling={sampling}"
    assert compare(look(open_page, view), picture, f"render-beside-{name}-{sampling}") < 0.01
    if name != "phong":
        return
    without = expected(DistantLight(coefficients), gloss=gloss, shadows=shadows)
    lit = without.sum(axis=-1) > 0
    assert np.abs(picture - without)[lit].mean() > 0.03 * FULL_SCALE, "gradients are to be seen"
    assert compare(look(open_page, f"{view}&gradients=0"), without, "render-beside-without") < 0.01


@pytest.mark.parametrize(("name", "gloss", "shadows", "sampling"), [LOOKS[0], LOOKS[3]])
def test_the_picture_among_two_probes_agrees_with_python(
    open_page: OpenPage, server: ServerProcess, stage: SampleSet, name: str, gloss: float, shadows: bool, sampling: str
) -> None:
    scene = {"camera": {"position": CAMERA[:3]}, "light": {"field": "stage"}}
    with ServerSources(server.url) as sources:
        light = load_scene(scene_settings(scene), Path(), sources).scene.light
    points = np.add(AT, [[0.1, 0.2, -0.1], [-0.6, 0.0, 0.0]])
    np.testing.assert_allclose(light.at(points), stage.at(points), atol=1e-5)
    view = f"light=field&field=stage&shadows={int(shadows)}&gloss={gloss}&exponent=6&sampling={sampling}"
    picture = expected(SampledLight(stage), gloss=gloss, shadows=shadows)
    assert compare(look(open_page, view), picture, f"render-field-{name}-{sampling}") < 0.01


def test_a_user_moves_object_and_probe_and_sees_what_gradients_do(open_page: OpenPage, probe: Publisher) -> None:
    show(probe, PROBE)
    page = open_page("#stream=probe&ev=0&gloss=0&theme=dark", size=PANEL)
    trust = page.get_by_test_id("trust")
    expect(trust).to_have_text(re.compile(r"From the probe\s*0\.00 m, trusted to 0\.30 m"))
    expect(page.get_by_test_id("probe-at")).to_have_text("0, 0.1, 0.5 m")
    # By number, by key, by handles.
    page.get_by_label("Object, x in metres").fill("0.2")
    page.get_by_label("Object, x in metres").press("Tab")
    expect(trust).to_contain_text("0.20 m, trusted")
    expect(page.get_by_text("farther from the probe than its light is trusted")).to_be_visible()
    page.locator("canvas").first.focus()
    page.keyboard.press("m")
    page.keyboard.press("I")
    page.wait_for_function("location.hash.includes('at=0.25,0.1,0.55')")
    page.get_by_role("switch", name="Move the object").check()
    page.wait_for_timeout(1500)
    keep_page(page, "gradients")
    with_gradients = settled(page)
    page.get_by_role("switch", name="Gradients").uncheck()
    page.wait_for_function("location.hash.includes('gradients=0')")
    without = see_until(page, lambda picture: bool(np.abs(picture - with_gradients).mean() > 0.5))
    assert np.abs(without - with_gradients).mean() > 0.5
    keep_page(page, "gradients-off")
    # Where nobody says where the probe stands, the user does.
    probe.position = None
    expect(page.get_by_label("Live probe, y in metres")).to_have_value("0")
    page.locator("canvas").first.focus()
    page.keyboard.press("Shift+U")
    page.keyboard.press("Shift+G")
    page.wait_for_function("location.hash.includes('probeAt=0,0.05,0') && location.hash.includes('probeGizmo=1')")
    expect(page.get_by_role("switch", name="Move the probe")).to_be_checked()
    page.get_by_role("button", name="to the probe").click()
    expect(trust).to_contain_text("0.00 m, trusted")
    # What the address says is what another window shows.
    again = open_page("#" + str(page.evaluate("location.hash")).removeprefix("#"), size=PANEL)
    expect(again.get_by_label("Live probe, y in metres")).to_have_value("0.05")


def test_a_user_makes_a_field_and_takes_it_away(
    open_page: OpenPage, stage: SampleSet, room: Publisher, console: list[str]
) -> None:
    page = open_page("#stream=left&theme=dark&tab=streams", size=PANEL)
    # The form shows what a proxy needs, and says what is missing where that is no single field.
    page.get_by_role("button", name="Add a stream").click()
    adding = page.get_by_role("form", name="New stream")
    adding.get_by_label("Name").fill("another")
    adding.get_by_label("Source").fill("synthetic:room")
    adding.get_by_label("Gradients: proxy").select_option("box")
    expect(adding.get_by_label("Gradients: box lower (m)")).to_be_visible()
    adding.get_by_role("button", name="Add", exact=True).click()
    expect(adding.get_by_role("alert")).to_contain_text("gradients")
    adding.get_by_label("Gradients: proxy").select_option("sphere")
    expect(adding.get_by_label("Gradients: radius (m)")).to_be_visible()
    adding.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Make a field").click()
    form = page.get_by_role("form", name="New field")
    form.get_by_label("Name").fill("set")
    form.get_by_label("room").check()
    form.get_by_role("button", name="Make the field").click()
    expect(form.get_by_role("alert")).to_contain_text("room")
    console.clear()  # the browser tells of the refusal
    form.get_by_label("room").uncheck()
    form.get_by_label("left").check()
    form.get_by_label("right").check()
    form.get_by_role("button", name="Make the field").click()
    card = page.get_by_test_id("field").filter(has_text=re.compile("^set"))
    expect(card.get_by_text("2 of 2")).to_be_visible()
    expect(page.get_by_test_id("badge")).to_have_text("Field of 2")
    page.wait_for_function("location.hash.includes('light=field') && location.hash.includes('field=set')")
    page.get_by_role("tab", name="Scene").click()
    page.get_by_label("Field").first.check()
    expect(page.get_by_test_id("trust")).to_contain_text("left")
    expect(page.get_by_test_id("trust")).to_contain_text("right")
    page.wait_for_timeout(1500)
    keep_page(page, "field")
    page.get_by_role("tab", name="Streams").click()
    card.get_by_role("button", name="Edit").click()
    card.get_by_label("right").uncheck()
    card.get_by_role("button", name="Save").click()
    expect(card.get_by_text("1 of 1")).to_be_visible()
    expect(page.get_by_test_id("badge")).to_have_text("Field of 1")
    card.get_by_role("button", name="Remove").click()
    card.get_by_role("button", name="Remove it for good?").click()
    expect(card).to_have_count(0)
    expect(page.get_by_test_id("badge")).to_have_text("Live")
