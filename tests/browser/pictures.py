"""Looking at what the page has drawn."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page

PATIENCE_SECONDS = 20.0
PAUSE_MS = 150.0
"""Between two looks: each costs the browser almost half a second of computing, in which it draws nothing else."""

Picture = NDArray[np.float64]


def decode(png: bytes) -> Picture:
    """Return a PNG as ``(H, W, 3)`` RGB, 0 … 255."""
    image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return image.astype(np.float64)


def see(page: Page) -> Picture:
    """Return what the page shows."""
    return decode(page.screenshot())


def see_until(page: Page, wanted: Callable[[Picture], bool]) -> Picture:
    """Look until the picture is as wanted; the last one where that does not come (the test then says how it is)."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while True:
        picture = see(page)
        if wanted(picture) or time.monotonic() > deadline:
            return picture
        page.wait_for_timeout(PAUSE_MS)


def objects(picture: Picture) -> Picture:
    """Cut out the middle, where bunny and ball are."""
    height, width, _ = picture.shape
    return picture[height // 4 : height * 3 // 4, width // 4 : width * 3 // 4]


def is_lit(picture: Picture) -> bool:
    """Say whether there are lit objects: many shades, neither all dark nor all bright."""
    middle = objects(picture)
    shades = len(np.unique(middle.reshape(-1, 3), axis=0))
    return bool(middle.std() > 12 and shades > 500 and 20 < middle.mean() < 235)


def settled(page: Page) -> Picture:
    """Look until nothing changes any more."""
    before = see(page)

    def unchanged(picture: Picture) -> bool:
        nonlocal before
        same = bool(np.abs(picture - before).mean() < 0.1)
        before = picture
        return same

    return see_until(page, unchanged)


def ball(picture: Picture) -> Picture:
    """Cut the ball out of a picture of 512 × 384 without the panel."""
    assert picture.shape == (384, 512, 3)
    return picture[160:250, 295:385]


def left_minus_right(picture: Picture) -> float:
    """Return by how much the left half is brighter than the right half."""
    half = picture.shape[1] // 2
    return float(picture[:, :half].mean() - picture[:, half:].mean())
