"""Chromium, a real server and publishers for the tests of the web page.

Playwright keeps an event loop running in this thread; the fixtures have the scope of one module, so that it has ended
before other tests run loops of their own.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect, sync_playwright
from tests.browser.publisher import Publisher
from tests.browser.server import ServerProcess

import lightwell_client

CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
VIEWPORT: ViewportSize = {"width": 512, "height": 384}

OpenPage = Callable[..., Page]

expect.set_options(timeout=20_000)  # machines that do much else


def _chromium() -> str:
    for name in (os.environ.get("LIGHTWELL_CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name) if name else None
        if found is not None:
            return found
    pytest.fail("the browser tests need Chromium: apt-get install chromium (or name one: LIGHTWELL_CHROMIUM=…)")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    executable = _chromium()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=CHROMIUM_FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    page = Path(lightwell_client.__path__[0], "static", "index.html")
    assert page.is_file(), "the web page has not been built: run script/setup"
    with ServerProcess(tmp_path_factory.mktemp("server")) as running:
        yield running


@pytest.fixture(scope="module")
def _room_stream(server: ServerProcess) -> Iterator[Publisher]:
    with Publisher(server.url, "room") as publisher:
        yield publisher


@pytest.fixture
def room(_room_stream: Publisher) -> Iterator[Publisher]:
    """A stream that is always there, with the light it had at first."""
    light, backdrop = _room_stream.coefficients, _room_stream.backdrop
    yield _room_stream
    _room_stream.coefficients, _room_stream.backdrop = light, backdrop
    _room_stream.silent.clear()


@pytest.fixture
def console() -> list[str]:
    """What the page has said on the console; must be empty in the end, unless the test empties it."""
    return []


@pytest.fixture
def open_page(browser: Browser, server: ServerProcess, console: list[str]) -> Iterator[OpenPage]:
    """Open the page with a hash; every page is closed afterwards, and must have kept quiet."""
    contexts = []

    def open_page(hash_: str = "", *, path: str = "/", size: ViewportSize | None = None) -> Page:
        context = browser.new_context(viewport=size or VIEWPORT)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(20_000)
        page.on("console", lambda message: console.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: console.append(f"exception: {error}"))
        page.goto(f"{server.url}{path}{hash_}")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert console == []
