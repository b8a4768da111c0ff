from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, Route, ViewportSize, expect
from tests.browser.conftest import OpenPage
from tests.browser.pictures import is_lit, see, see_until
from tests.browser.publisher import Publisher
from tests.browser.server import ServerProcess

pytestmark = [pytest.mark.browser, pytest.mark.timeout(90)]

WIDE: ViewportSize = {"width": 800, "height": 384}


def badge(page: Page, text: str) -> None:
    expect(page.get_by_test_id("badge")).to_have_text(text, timeout=20_000)


def test_the_page_comes_back_after_the_server_does(
    open_page: OpenPage, server: ServerProcess, room: Publisher, console: list[str]
) -> None:
    page = open_page("#stream=room&backdrop=off&hud=0", size=WIDE)
    badge(page, "Live")
    see_until(page, is_lit)
    server.kill()
    badge(page, "Reconnecting")
    expect(page.get_by_role("alert")).to_contain_text("Trying again")
    assert is_lit(see(page)), "the last light stays"
    server.start()
    badge(page, "Live")
    assert page.evaluate("document.querySelector('.trouble')") is None
    # Chromium itself reports each connection that fails, and no page can prevent it.
    assert all("ERR_CONNECTION_REFUSED" in line or "WebSocket connection to" in line for line in console), console
    console.clear()


def test_a_stream_that_falls_silent_is_called_stalled(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=room", size=WIDE)
    badge(page, "Live")
    room.silent.set()
    badge(page, "Stalled")
    expect(page.get_by_role("alert")).to_contain_text(re.compile(r"No new light for \d+ s"))
    room.silent.clear()
    badge(page, "Live")


def test_an_unknown_stream_is_said_in_words(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#stream=nowhere", size=WIDE)
    expect(page.get_by_role("alert")).to_contain_text("there is no stream 'nowhere'")
    page.get_by_label("Stream", exact=True).select_option("room")
    badge(page, "Live")


def test_without_streams_the_page_says_what_to_run(open_page: OpenPage, room: Publisher) -> None:
    page = open_page("#theme=dark")
    page.context.route("**/api/v1/streams", lambda route: _no_streams(route))
    page.goto("about:blank")
    page.goto(f"{room.url.split('/api')[0].replace('ws', 'http', 1)}/")
    expect(page.get_by_text("No streams yet")).to_be_visible()
    expect(page.get_by_text("lightwell ingest")).to_be_visible()
    page.context.unroute_all(behavior="wait")
    badge(page, "Live")
    expect(page.get_by_text("No streams yet")).to_have_count(0)


def _no_streams(route: Route) -> None:
    route.fulfill(json={"streams": []})
