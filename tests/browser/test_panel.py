"""The panel: its tabs, forms and the time bar, by mouse and by keyboard, wide and narrow."""

from __future__ import annotations

import re
from typing import Literal

import pytest
from playwright.sync_api import Page, ViewportSize, expect
from tests.browser.conftest import OpenPage
from tests.browser.files import ARTEFACTS, keep
from tests.browser.pictures import ball, left_minus_right, see_until
from tests.browser.publisher import Publisher, distant_light
from tests.browser.results import lit_and_dark, put_grid
from tests.browser.server import ServerProcess

pytestmark = [pytest.mark.browser, pytest.mark.timeout(150)]

SIZE: ViewportSize = {"width": 900, "height": 620}
NARROW: ViewportSize = {"width": 360, "height": 640}
TABS = ["Scene", "Streams", "Jobs", "Captures", "Grids", "Files"]


def badge(page: Page, text: str) -> None:
    expect(page.get_by_test_id("badge")).to_have_text(text, timeout=30_000)


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=re.compile(f"^{name}")).click()


def test_one_looks_back_over_half_a_minute(open_page: OpenPage, room: Publisher) -> None:
    room.coefficients = distant_light((-1, -0.3, 0.3))
    page = open_page("#stream=room&panel=0&hud=0&backdrop=off&ev=0&theme=dark")
    see_until(page, lambda picture: left_minus_right(ball(picture)) > 20)
    page.wait_for_timeout(3000)
    room.coefficients = distant_light((1, -0.3, 0.3))
    now = see_until(page, lambda picture: left_minus_right(ball(picture)) < -20)
    assert left_minus_right(ball(now)) < -20
    page.wait_for_timeout(1000)
    page.keyboard.press("p")
    time = page.get_by_label("Time")
    expect(time).to_have_attribute("aria-valuetext", "following the newest")
    time.fill("-3.5")
    badge(page, "Paused")
    expect(page.get_by_test_id("time-words")).to_contain_text("s back")
    page.set_viewport_size(SIZE)
    keep(page, "time")
    page.set_viewport_size({"width": 512, "height": 384})
    page.get_by_role("button", name="Close the panel").click()
    past = see_until(page, lambda picture: left_minus_right(ball(picture)) > 20)
    assert left_minus_right(ball(past)) > 20
    page.locator("canvas").first.focus()  # a button would take the space bar for itself
    page.keyboard.press(".")
    page.keyboard.press(",")
    badge(page, "Paused")
    page.keyboard.press(" ")
    badge(page, "Live")
    following = see_until(page, lambda picture: left_minus_right(ball(picture)) < -20)
    assert left_minus_right(ball(following)) < -20


def test_a_stream_is_added_changed_and_removed(open_page: OpenPage, room: Publisher, console: list[str]) -> None:
    page = open_page("#stream=room&tab=streams&backdrop=off", size=SIZE)
    badge(page, "Live")
    page.get_by_role("button", name="Add a stream…").click()
    form = page.get_by_role("form", name="New stream")
    form.get_by_label("Name").fill("hall")
    form.get_by_label("Source").fill("synthetic:attic")
    form.get_by_role("button", name="Add", exact=True).click()
    expect(form.locator(".field.invalid")).to_contain_text("no scene 'attic'")
    expect(form.get_by_label("Source")).to_be_focused()
    keep(page, "stream-refused")
    form.get_by_role("button", name="synthetic:room").click()
    expect(form.get_by_label("Source")).to_have_value("synthetic:room")
    form.get_by_role("button", name="Add", exact=True).click()
    expect(form).to_have_count(0)
    page.wait_for_function("location.hash.includes('stream=hall')")
    card = page.get_by_test_id("stream").filter(has_text="hall")
    expect(card).to_have_attribute("data-state", "running", timeout=60_000)
    badge(page, "Live")
    card.get_by_text("Counts").click()
    expect(card).to_contain_text("Latency")
    expect(card).to_contain_text("Missed by this page")
    keep(page, "streams")
    card.get_by_role("button", name="Edit").click()
    form = page.get_by_role("form", name="Settings of hall")
    form.get_by_text("More settings").click()
    form.get_by_label("Bands").fill("2")
    form.get_by_role("button", name="Save").click()
    expect(form).to_have_count(0)
    tab(page, "Scene")
    expect(page.locator(".coefficients rect")).to_have_count(12, timeout=30_000)
    tab(page, "Streams")
    card.get_by_role("button", name="Remove").click()
    card.get_by_role("button", name="Remove it for good?").click()
    expect(card).to_have_count(0)
    page.wait_for_function("location.hash.includes('stream=room')")
    badge(page, "Live")
    # Chromium itself reports the answer that was an error.
    assert all("422" in line for line in console), console
    console.clear()


def test_without_a_mouse(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&backdrop=off", size=SIZE)
    badge(page, "Live")
    page.keyboard.press("3")
    expect(page.get_by_role("tab", name=re.compile("^Jobs"))).to_have_attribute("aria-selected", "true")
    page.get_by_role("tab", name=re.compile("^Jobs")).focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("tab", name="Captures")).to_be_focused()
    page.keyboard.press("Home")
    expect(page.get_by_role("tab", name="Scene")).to_be_focused()
    page.keyboard.press("Tab")
    expect(page.get_by_label("Stream", exact=True)).to_be_focused()
    page.keyboard.press("Tab")
    expect(page.get_by_role("button", name="Pause")).to_be_focused()
    page.keyboard.press("Enter")
    badge(page, "Paused")
    page.keyboard.press("Tab")
    expect(page.get_by_label("Time")).to_be_focused()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Enter")
    badge(page, "Live")
    page.keyboard.press("2")
    page.get_by_role("tab", name="Streams").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    form = page.get_by_role("form", name="New stream")
    expect(form).to_be_visible()
    page.keyboard.press("Tab")
    # Every stop says where it is: a ring that can be seen.
    seen = set()
    for _ in range(12):
        ring, name = page.evaluate(
            "(e => { const style = getComputedStyle(e.matches('.segments input') ? e.nextElementSibling : e);"
            " return [style.outlineStyle, e.tagName + e.id + e.textContent.slice(0, 20)]; })(document.activeElement)"
        )
        assert ring == "solid", name
        seen.add(name)
        page.keyboard.press("Tab")
    assert len(seen) == 12


def listed(page: Page) -> None:
    """Wait until the tab has heard from the server."""
    expect(page.get_by_text("Asking the server…")).to_have_count(0)


def test_every_tab_fits_into_windows_of_all_widths(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&panel=1&backdrop=off", size=NARROW)
    badge(page, "Live")
    for name in TABS:
        tab(page, name)
        listed(page)
        if name == "Streams":
            page.get_by_role("button", name="Add a stream…").click()
            page.get_by_text("More settings").click()
        if name == "Jobs":
            page.get_by_role("button", name="New job…").click()
            page.get_by_label("Kind", exact=True).select_option("ilf-grid")
        keep(page, f"narrow-{name.lower()}")
        for width in (360, 480, 719, 720, 1024):
            page.set_viewport_size({"width": width, "height": 640})
            # The latency's graph takes its new width with the next picture.
            page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate(OVER, width) == [], (name, width)
        page.set_viewport_size(NARROW)


OVER = """width => [...document.querySelectorAll('.panel *, .hud, .tray')]
  .filter(e => e.getBoundingClientRect().right > width + 0.5 && !e.closest('pre, code'))
  .map(e => e.outerHTML.slice(0, 80))"""


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_words_can_be_read(open_page: OpenPage, room: Publisher, theme: str) -> None:
    """Text has a contrast of 4.5 against the panel, in every tab (WCAG AA)."""
    page = open_page(f"#stream=room&backdrop=off&theme={theme}", size=SIZE)
    badge(page, "Live")
    for name in TABS:
        tab(page, name)
        listed(page)
        keep(page, f"{theme}-{name.lower()}")
        faint = page.evaluate(CONTRASTS, "#161519" if theme == "dark" else "#fbf9f5")
        assert faint == [], name


CONTRASTS = """ground => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  canvas.canvas.width = canvas.canvas.height = 1;
  const paint = layers => {
    for (const layer of layers) { canvas.fillStyle = layer; canvas.fillRect(0, 0, 1, 1); }
    return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
  };
  const luminance = rgb => rgb
    .map(value => value / 255)
    .map(value => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4)
    .reduce((sum, value, i) => sum + value * [0.2126, 0.7152, 0.0722][i], 0);
  const faint = [];
  const walker = document.createTreeWalker(document.querySelector(".panel"), NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.textContent.trim() || element.closest(":disabled, option, svg, [hidden]")) continue;
    if (element.getClientRects().length === 0) continue;
    const layers = [];
    for (let e = element; e && !e.matches(".panel"); e = e.parentElement) {
      layers.unshift(getComputedStyle(e).backgroundColor);
    }
    const behind = [ground, ...layers];
    const [a, b] = [luminance(paint(behind)), luminance(paint([...behind, getComputedStyle(element).color]))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5) faint.push(`${contrast.toFixed(2)} ${node.textContent.trim().slice(0, 40)}`);
  }
  return faint;
}"""


def test_the_badge_says_whose_light_it_is(open_page: OpenPage, room: Publisher, server: ServerProcess) -> None:
    grid, _ = put_grid(server, "b0" * 10, lit_and_dark())
    page = open_page(f"#stream=room&light=grid&grid={grid}&backdrop=off", size=SIZE)
    badge(page, "Grid")
    expect(page.get_by_label("Stream", exact=True)).to_have_count(0)  # it has no part in what is seen
    page.get_by_role("radio", name="Both").check(force=True)
    badge(page, "Grid × live")
    page.get_by_role("button", name="Pause").click()
    badge(page, "Grid × paused")
    page.get_by_role("radio", name="Live").check(force=True)
    badge(page, "Paused")
    page.get_by_role("radio", name="Grid", exact=True).check(force=True)
    badge(page, "Grid")
    # The object as large as it is, and moved by keys while a switch has the focus.
    page.get_by_role("radio", name="True").check(force=True)
    expect(page.get_by_test_id("sizes")).to_have_text(re.compile(r"^3\.6 m across.* 3 × 2 × 1\.2 m\.$"))
    page.wait_for_function("location.hash.includes('size=true')")
    page.get_by_label("Move the object").check()
    page.keyboard.press("m")
    expect(page.get_by_test_id("at")).to_have_text("0.15, 0, 0.6 m")
    keep(page, "true-size")


def test_who_wants_less_motion_gets_none(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&backdrop=off", size=SIZE)
    badge(page, "Live")
    assert page.evaluate(MOVING) == ["breathe", "0.15s"]
    page.emulate_media(reduced_motion="reduce")
    assert page.evaluate(MOVING) == ["none", "0s"]


MOVING = """() => {
  const meter = document.createElement("div");
  meter.className = "meter unknown";
  meter.append(document.createElement("span"));
  document.querySelector(".panel .body").append(meter);
  const toggle = getComputedStyle(document.querySelector(".toggle input"));
  const moving = [getComputedStyle(meter.firstChild).animationName, toggle.transitionDuration];
  meter.remove();
  return moving;
}"""


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_theme_is_the_systems(open_page: OpenPage, room: Publisher, scheme: Literal["dark", "light"]) -> None:
    page = open_page("#stream=room&backdrop=off", size=SIZE)
    page.emulate_media(color_scheme=scheme)
    page.wait_for_function("scheme => document.documentElement.dataset.theme === scheme", arg=scheme)
    assert page.evaluate("getComputedStyle(document.documentElement).colorScheme") == scheme


def test_the_token_goes_along_with_every_request(open_page: OpenPage, room: Publisher, console: list[str]) -> None:
    page = open_page("#tab=jobs", path="/?token=wrong%2Btoken", size=SIZE)
    expect(page.get_by_role("alert").first).to_contain_text("token", timeout=60_000)
    for name in TABS:
        tab(page, name)
        listed(page)
    asked = page.evaluate("performance.getEntriesByType('resource').map(e => e.name).filter(n => n.includes('/api/'))")
    assert len(asked) > 5
    assert all("token=wrong%2Btoken" in url for url in asked), asked
    page.context.close()  # it asks again and again
    assert all("401" in line or "WebSocket" in line for line in console), console
    console.clear()


def test_the_page_paints_at_once(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room&backdrop=off", size=SIZE)
    badge(page, "Live")
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    ARTEFACTS.mkdir(exist_ok=True)
    (ARTEFACTS / "first-paint.txt").write_text(f"first contentful paint: {paint:.0f} ms\n", encoding="utf-8")
    assert paint < 5000  # a second on a quiet machine, see the file; tests run beside much else
