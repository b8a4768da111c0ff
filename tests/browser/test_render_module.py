"""The module for other people's pages, by its example page."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from tests.browser.conftest import OpenPage
from tests.browser.pictures import Picture, see_until
from tests.browser.publisher import Publisher, distant_light
from tests.browser.results import lit_and_dark, put_grid
from tests.browser.server import ServerProcess

import lightwell_client

pytestmark = [pytest.mark.browser, pytest.mark.timeout(90)]

STATIC = Path(lightwell_client.__path__[0], "static")


def bright(picture: Picture) -> bool:
    return bool(picture.std() > 20)


def test_the_module_is_small_and_leaves_three_to_the_page() -> None:
    text = (STATIC / "lightwell-three.js").read_text(encoding="utf-8")
    assert len(gzip.compress(text.encode())) < 25_000
    assert 'from"three"' in text.replace(" ", "")
    assert "LightwellProbe" in text
    assert "LightwellGrid" in text


def test_the_module_ships_its_types() -> None:
    """What they say is compared with a stranger's page in ``types.test.ts``."""
    text = (STATIC / "lightwell-three.d.ts").read_text(encoding="utf-8")
    for name in ("LightwellProbe", "LightwellGrid"):
        assert f"export declare class {name} " in text


def test_a_page_is_lit_by_a_stream(open_page: OpenPage, room: Publisher) -> None:
    page = open_page(path="/example.html", hash_="?stream=room", size={"width": 800, "height": 500})
    columns = {"three's material": slice(120, 300), "ours": slice(300, 500), "ours, glossy": slice(500, 760)}

    def middles(picture: Picture) -> dict[str, float]:
        """Return the row about which each mesh is bright."""
        rows = np.arange(len(picture))
        sums = {name: picture[:, part].sum(axis=(1, 2)) for name, part in columns.items()}
        return {name: float(rows @ values / max(values.sum(), 1)) for name, values in sums.items()}

    # +Z of Lightwell is up in the page.
    room.coefficients = distant_light((0, 0, 1))
    above = middles(see_until(page, bright))
    room.coefficients = distant_light((0, 0, -1))
    below = middles(see_until(page, lambda picture: all(middles(picture)[name] > above[name] + 5 for name in columns)))
    for name in columns:
        assert below[name] > above[name] + 5, name


def test_a_page_is_lit_by_a_grid(open_page: OpenPage, room: Publisher, server: ServerProcess) -> None:
    name, _ = put_grid(server, "grid-for-a-page", lit_and_dark())
    query = f"?stream=room&grid={name}"
    page = open_page(path="/example.html", hash_=query, size={"width": 800, "height": 500})
    # The mesh wanders from the bright left to the dark right and back.
    levels: list[float] = []

    def both_seen(picture: Picture) -> bool:
        levels.append(float(np.sort(picture.min(axis=-1).ravel())[-200:].mean()))
        return len(levels) > 6 and max(levels) - min(levels) > 25

    assert both_seen(see_until(page, both_seen))


def test_a_grid_that_is_not_there_is_said_in_words(open_page: OpenPage, room: Publisher, console: list[str]) -> None:
    page = open_page(path="/example.html", hash_="?stream=room&grid=no-such-job.grid")
    page.wait_for_function("document.getElementById('note').textContent.includes('there is no artefact')")
    # Chromium itself reports each answer that is an error.
    assert all("404" in line for line in console), console
    console.clear()
