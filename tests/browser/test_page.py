from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, ViewportSize, expect
from tests.browser.conftest import OpenPage
from tests.browser.pictures import ball, decode, is_lit, left_minus_right, objects, see, see_until, settled
from tests.browser.publisher import Publisher, distant_light
from tests.browser.server import ServerProcess

pytestmark = [pytest.mark.browser, pytest.mark.timeout(90)]

WIDE: ViewportSize = {"width": 800, "height": 384}
BARE = "stream=room&panel=0&hud=0&backdrop=off&ev=0&theme=dark"


def figure(page: Page, name: str) -> float:
    match = re.search(r"[\d.]+", page.get_by_test_id(f"hud-{name}").inner_text())
    return float(match[0]) if match else 0.0


def wait_for_live(page: Page) -> None:
    expect(page.get_by_test_id("badge")).to_have_text("Live", timeout=20_000)


@pytest.mark.parametrize("shadows", [1, 0])
def test_the_objects_follow_the_light(open_page: OpenPage, room: Publisher, shadows: int) -> None:
    page = open_page(f"#{BARE}&shadows={shadows}")
    room.coefficients = distant_light((-1, -0.3, 0.3))
    from_left = see_until(page, lambda picture: is_lit(picture) and left_minus_right(ball(picture)) > 20)
    assert is_lit(from_left)
    assert left_minus_right(ball(from_left)) > 20
    room.coefficients = distant_light((1, -0.3, 0.3))
    from_right = see_until(page, lambda picture: left_minus_right(ball(picture)) < -20)
    assert is_lit(from_right)
    assert left_minus_right(ball(from_right)) < -20


def test_colour_of_the_light_is_seen(open_page: OpenPage, room: Publisher) -> None:
    room.coefficients = distant_light((0, -1, 1)) * [2.0, 0.5, 0.1]
    page = open_page(f"#{BARE}")
    picture = see_until(page, lambda picture: bool(np.ptp(objects(picture).mean((0, 1))) > 40))
    red, green, blue = objects(picture).mean((0, 1))
    assert red > green + 20 > blue + 20


def test_measurements_are_numbers(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room", size=WIDE)
    wait_for_live(page)
    page.wait_for_function(
        "['stream', 'latency'].every(name =>"
        " parseFloat(document.querySelector(`[data-testid=hud-${name}]`).textContent) > 0)"
    )
    # What piled up while the page started comes at once: the rate is right when that has passed.
    page.wait_for_function("parseFloat(document.querySelector('[data-testid=hud-stream]').textContent) < 60")
    assert figure(page, "stream") >= 1
    assert 0 < figure(page, "latency") < 5000
    # Light that stays the same is drawn once, light that changes as it comes.
    expect(page.get_by_test_id("hud-render")).to_have_text("idle")
    for step in range(30):
        room.coefficients = distant_light((step / 15 - 1, -0.3, 0.3))
        page.wait_for_timeout(40)
    assert figure(page, "render") > 0
    expect(page.get_by_test_id("hud-missed")).to_have_text(re.compile(r"\d+"))
    expect(page.locator(".coefficients rect")).to_have_count(75)
    page.get_by_role("tab", name="Streams").click()
    health = page.get_by_test_id("health")
    for words in ("auto, λ 0.012", "3 NaN", "2.1 % of the sphere", "2 unreadable"):
        expect(health).to_contain_text(words)
    expect(page.locator(".graph canvas")).to_be_visible()


def test_a_stream_is_chosen_and_another_can_be_picked(
    open_page: OpenPage, server: ServerProcess, room: Publisher
) -> None:
    with Publisher(server.url, "studio") as studio:
        studio.coefficients = distant_light((0, -1, 1), irradiance=0.5)
        page = open_page("", size=WIDE)
        wait_for_live(page)
        picker = page.get_by_label("Stream", exact=True)
        expect(picker).to_have_value("room")
        expect(picker.locator("option")).to_have_text(["room", "studio"])
        picker.select_option("studio")
        page.wait_for_function("location.hash.includes('stream=studio')")
        wait_for_live(page)


def brightness(picture: NDArray[np.float64]) -> float:
    """Return the mean of the part left of the panel."""
    return float(picture[100:300, 100:400].mean())


def test_exposure(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&hud=0&backdrop=off&theme=dark", size=WIDE)
    wait_for_live(page)
    slider = page.get_by_label("Exposure")
    expect(slider).to_have_attribute("aria-valuetext", re.compile("auto"))
    slider.fill("-6")
    page.wait_for_function("location.hash.includes('ev=-6')")
    dark = see_until(page, lambda picture: brightness(picture) < 50)
    slider.fill("0.5")
    bright = see_until(page, lambda picture: brightness(picture) > 90)
    assert brightness(dark) < 50
    assert brightness(bright) > 90
    slider.dblclick()
    expect(slider).to_have_attribute("aria-valuetext", re.compile("auto"))


def test_the_view_is_in_the_address(open_page: OpenPage, room: Publisher) -> None:
    page = open_page(
        "#stream=room&ev=1.5&camera=2,-6,3,0,0,0.5&colour=cc4422&gloss=0.5&exponent=8&bands=3"
        "&backdrop=harmonics&arrow=1&shadows=0&panel=1",
        size={"width": 1000, "height": 700},
    )
    wait_for_live(page)
    expect(page.get_by_label("Exposure")).to_have_attribute("aria-valuetext", "+1.5 EV")
    expect(page.get_by_label("Gloss")).to_have_attribute("aria-valuetext", "50 %")
    expect(page.get_by_label("Colour")).to_have_value("#cc4422")
    expect(page.get_by_label("Shadows")).not_to_be_checked()
    expect(page.get_by_label("Dominant light")).to_be_checked()
    expect(page.get_by_role("radio", name="Harmonics")).to_be_checked()
    expect(page.get_by_role("radio", name="3", exact=True)).to_be_checked()
    page.get_by_label("Gloss").fill("0.25")
    page.get_by_role("radio", name="Off").check(force=True)
    page.wait_for_function("location.hash.includes('gloss=0.25') && location.hash.includes('backdrop=off')")
    address = page.evaluate("location.hash")
    page.reload()
    wait_for_live(page)
    expect(page.get_by_label("Gloss")).to_have_attribute("aria-valuetext", "25 %")
    page.wait_for_timeout(400)  # longer than the page waits before it writes the address
    assert page.evaluate("location.hash") == address
    assert "camera=2,-6,3,0,0,0.5" in address


def test_camera(open_page: OpenPage, room: Publisher) -> None:
    page = open_page(f"#{BARE}")
    see_until(page, is_lit)
    home = settled(page)
    canvas = page.locator("canvas").first
    page.mouse.move(250, 200)
    page.mouse.down()
    page.mouse.move(350, 180, steps=3)
    page.mouse.up()
    page.wait_for_function("location.hash.includes('camera=')")
    turned = see(page)
    assert np.abs(turned - home).mean() > 3
    page.keyboard.press("r")
    page.wait_for_function("!location.hash.includes('camera=')")
    again = see_until(page, lambda picture: bool(np.abs(objects(picture) - objects(home)).mean() < 1))
    assert np.abs(objects(again) - objects(home)).mean() < 1
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("location.hash.includes('camera=')")
    page.keyboard.press("r")
    page.wait_for_function("!location.hash.includes('camera=')")
    canvas.dblclick(position={"x": 230, "y": 180})
    page.wait_for_function("location.hash.includes('camera=')")


def test_backdrop(open_page: OpenPage, room: Publisher) -> None:
    # The upper half of the sphere is green in the picture; the coefficients are grey.
    room.backdrop = np.full((32, 64, 3), 0.02)
    room.backdrop[:, :, 1] = 0.6
    page = open_page("#stream=room&panel=0&hud=0&ev=0")

    def greenness(picture: NDArray[np.float64]) -> float:
        corner = picture[:60, :60].mean((0, 1))
        return float(corner[1] - corner[0])

    assert greenness(see_until(page, lambda picture: greenness(picture) > 40)) > 40
    page.keyboard.press("b")
    assert greenness(see_until(page, lambda picture: greenness(picture) < 10)) < 10


def test_pause_holds_the_light(open_page: OpenPage, room: Publisher) -> None:
    page = open_page(f"#{BARE}".replace("panel=0", "panel=1"), size={"width": 900, "height": 500})
    wait_for_live(page)
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_test_id("badge")).to_have_text("Paused")
    page.get_by_role("tab", name="Streams").click()
    source = page.get_by_test_id("health").locator("dd").last
    page.wait_for_timeout(400)  # the panel follows four times a second
    held = source.inner_text()
    page.wait_for_timeout(600)
    assert source.inner_text() == held
    page.get_by_role("tab", name="Scene").click()
    page.get_by_role("button", name="Follow").click()
    page.get_by_role("tab", name="Streams").click()
    expect(source).not_to_have_text(held)
    wait_for_live(page)


def test_screenshot_is_the_picture(open_page: OpenPage, room: Publisher, tmp_path: Path) -> None:
    page = open_page(f"#{BARE}")
    see_until(page, is_lit)
    with page.expect_download() as download:
        page.keyboard.press("s")
    path = tmp_path / "screenshot.png"
    download.value.save_as(path)
    assert re.fullmatch(r"lightwell-room-.*\.png", download.value.suggested_filename)
    assert is_lit(decode(path.read_bytes()))


def test_copy_link(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&gloss=0.4")
    wait_for_live(page)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.keyboard.press("l")
    expect(page.get_by_text("Link copied")).to_be_visible()
    link = page.evaluate("navigator.clipboard.readText()")
    assert "stream=room" in link
    assert "gloss=0.4" in link
    assert "ev=" in link


def test_software_rendering_is_noticed(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room")
    notice = page.get_by_test_id("software-notice")
    expect(notice).to_contain_text("software")
    notice.get_by_role("button", name="Dismiss").click()
    expect(notice).to_have_count(0)


def test_a_narrow_window_fits(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room", size={"width": 360, "height": 640})
    wait_for_live(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    expect(page.get_by_label("Exposure")).to_have_count(0)
    page.get_by_role("button", name="Open the panel").click()
    expect(page.get_by_label("Exposure")).to_be_visible()
    box = page.get_by_role("complementary").bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 360
    assert box["y"] > 200
    overflowing = page.evaluate(
        "[...document.querySelectorAll('.panel *')].filter(e => e.getBoundingClientRect().right > 360.5).length"
    )
    assert overflowing == 0


def test_keyboard(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room", size={"width": 900, "height": 600})
    wait_for_live(page)
    page.keyboard.press("?")
    help_dialog = page.get_by_role("dialog", name="Keys and mouse")
    expect(help_dialog).to_be_visible()
    page.keyboard.press("Escape")
    expect(help_dialog).to_have_count(0)
    page.keyboard.press("h")
    expect(page.get_by_test_id("hud-stream")).to_have_count(0)
    page.keyboard.press("p")
    expect(page.get_by_label("Exposure")).to_have_count(0)
    page.keyboard.press("p")
    page.get_by_label("Exposure").focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_label("Exposure")).not_to_have_attribute("aria-valuetext", re.compile("auto"))
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    assert page.evaluate(outline) == "solid"


def test_themes(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&theme=light&backdrop=off", size={"width": 900, "height": 600})
    wait_for_live(page)
    light = see(page)[-40:, :40].mean()
    page.get_by_role("radio", name="Dark").check(force=True)
    page.wait_for_function("document.documentElement.dataset.theme === 'dark'")
    assert light > 150 > 90 > see(page)[-40:, :40].mean()


def test_the_graphics_compute_the_same_harmonics(open_page: OpenPage) -> None:
    page = open_page(path="/selfcheck.html")
    result = page.locator("#result[data-passed]")
    expect(result).to_have_attribute("data-passed", "true", timeout=60_000)  # it compiles a hundred shaders
    errors = [float(text) for text in re.findall(r": (\S+e\S+)", result.inner_text())]
    assert len(errors) == 7
    assert max(errors) < 1e-5
