"""Films: readable, of the pictures that went in, and the same bytes from any process."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lightwell.errors import RenderError
from lightwell.io.films import write_film


def flickering(count: int = 12, height: int = 99, width: int = 161) -> list[NDArray[np.uint8]]:
    """Return pictures of odd sides, of soft blots that grow darker and brighter, with grain."""
    chance = np.random.default_rng(1)
    noise = chance.uniform(0, 255, (height, width, 3)).astype(np.float32)
    blots = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 8), np.zeros_like(noise), 0, 255, cv2.NORM_MINMAX)
    levels = [0.4 + 0.6 * ((7 * k) % 5) / 4 for k in range(count)]
    return [np.clip(blots * level + chance.normal(0, 4, blots.shape), 0, 255).astype(np.uint8) for level in levels]


def test_a_film_shows_the_pictures(tmp_path: Path) -> None:
    pictures = flickering()
    write_film(tmp_path / "a.mp4", pictures, 30)
    with av.open(str(tmp_path / "a.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.average_rate, stream.codec_context.name) == (Fraction(30), "h264")
        shown = [frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray() for frame in film.decode(video=0)]
    assert [one.shape for one in shown] == [(100, 162, 3)] * len(pictures)
    for one, picture in zip(shown, pictures, strict=True):
        assert np.abs(one[:99, :161].astype(float) - picture).mean() < 6
    write_film(tmp_path / "one.mp4", pictures[:1], 23.976)
    with av.open(str(tmp_path / "one.mp4")) as film:
        assert len(list(film.decode(video=0))) == 1
    with pytest.raises(RenderError, match="no pictures"):
        write_film(tmp_path / "none.mp4", [], 24)
    assert not list(tmp_path.glob(".*"))


def test_films_have_the_same_bytes_whatever_was_in_memory(tmp_path: Path) -> None:
    found = set()
    for fill in ("0", "1", "170"):
        path = tmp_path / f"{fill}.mp4"
        code = f"from tests.core.io.test_films import *; write_film(Path({str(path)!r}), flickering(), 24)"
        subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"MALLOC_PERTURB_": fill}, timeout=60)
        found.add(hashlib.sha256(path.read_bytes()).hexdigest())
    assert len(found) == 1
