"""Frame times of the web page's picture at 512 × 384 in Chromium's software renderer, as ratios to the diffuse one.

Without a graphics card milliseconds say little beyond this machine; the ratios say what each kind of light and surface
costs. Needs Chromium (``LIGHTWELL_CHROMIUM`` names one) and the built page.
"""

from __future__ import annotations

import json
import os
import shutil
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

import lightwell_client
from bench.report import Row, row

FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
BASELINE = "diffuse"
PATIENCE_MS = 300_000


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        del format, args


def run() -> list[Row]:
    """Open the page ``frames.html`` and return what it has measured."""
    static = Path(lightwell_client.__path__[0], "static")
    if not (static / "frames.html").is_file():
        raise SystemExit("the web page has not been built: run script/setup")
    chromium = next(
        filter(None, map(shutil.which, (os.environ.get("LIGHTWELL_CHROMIUM", "chromium"), "chromium"))), None
    )
    if chromium is None:
        raise SystemExit("no Chromium: apt-get install chromium (or name one: LIGHTWELL_CHROMIUM=…)")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(static))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            found = _measure(chromium, f"http://127.0.0.1:{server.server_address[1]}/frames.html")
        finally:
            server.shutdown()
    baseline = found[BASELINE]
    return [row(f"page, {name}", value, "ms", baseline) for name, value in found.items()]


def _measure(chromium: str, url: str) -> dict[str, float]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        page = browser.new_page()
        page.goto(url)
        result = page.locator("#result[data-done]")
        result.wait_for(timeout=PATIENCE_MS)
        text, done = result.inner_text(), result.get_attribute("data-done")
        browser.close()
    if done != "true":
        raise SystemExit(f"the page could not measure: {text}")
    milliseconds: dict[str, float] = json.loads(text)["ms"]
    return milliseconds
