"""Pictures on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from lightwell.errors import RenderError
from lightwell.geometry.shapes import box
from lightwell.io.exr import read_rgb
from lightwell.io.renders import require_format, write_rendering
from lightwell.render import Camera, DistantLight, Harmonics, Rendering, Scene, SceneObject, expose_and_encode, render

LIGHT = np.zeros((4, 3))
LIGHT[0], LIGHT[2] = [3.0, 2.0, 1.0], 0.5


def picture(backdrop: bool) -> Rendering:
    scene = Scene((SceneObject(box()),), DistantLight(LIGHT), Harmonics(LIGHT) if backdrop else None)
    return render(scene, Camera((1.0, -4.0, 2.0), (0.0, 0.0, 0.0)), (20, 14), 2)


@pytest.mark.parametrize("backdrop", [False, True])
def test_exr_holds_all_layers(tmp_path: Path, backdrop: bool) -> None:
    rendering = picture(backdrop)
    file = tmp_path / "x.exr"
    write_rendering(file, rendering, ev=3)
    np.testing.assert_array_equal(read_rgb(file).pixels, rendering.colour)
    channels = OpenEXR.File(str(file), separate_channels=True).channels()
    np.testing.assert_array_equal(channels["Z"].pixels, rendering.depth)
    np.testing.assert_array_equal(channels["coverage"].pixels, rendering.coverage)
    np.testing.assert_array_equal(
        channels["A"].pixels, np.ones_like(rendering.coverage) if backdrop else rendering.coverage
    )
    np.testing.assert_array_equal(channels["normal.Y"].pixels, rendering.normal[..., 1])
    np.testing.assert_array_equal(channels["albedo.B"].pixels, rendering.albedo[..., 2])
    assert [path.name for path in tmp_path.iterdir()] == ["x.exr"]


def test_png_is_what_a_screen_shows(tmp_path: Path) -> None:
    rendering = picture(True)
    write_rendering(tmp_path / "x.png", rendering, ev=-1)
    read = cv2.imread(str(tmp_path / "x.png"), cv2.IMREAD_UNCHANGED)
    assert read is not None
    np.testing.assert_array_equal(read[..., ::-1], expose_and_encode(rendering.colour, -1))


def test_png_without_a_backdrop_is_transparent_with_full_colours_at_edges(tmp_path: Path) -> None:
    rendering = picture(False)
    write_rendering(tmp_path / "x.PNG", rendering, tone_mapping=False)
    read = cv2.imread(str(tmp_path / "x.PNG"), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert read.shape == (14, 20, 4)
    np.testing.assert_array_equal(read[..., 3], np.rint(rendering.coverage * 255))
    edge = (rendering.coverage > 0) & (rendering.coverage < 1)
    assert edge.any()
    straight = rendering.colour[edge] / rendering.coverage[edge][:, None]
    np.testing.assert_array_equal(read[edge][:, 2::-1], expose_and_encode(straight, tone_mapping=False))


def test_other_names_are_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    for name, message in {
        "x.jpg": "as .exr or .png, not as .jpg",
        "x": "a name without type",
        "none/x.png": "does not exist",
    }.items():
        with pytest.raises(RenderError, match=message):
            require_format(tmp_path / name)
    (tmp_path / "d.png").mkdir()
    with pytest.raises(RenderError, match="is a folder"):
        require_format(tmp_path / "d.png")
