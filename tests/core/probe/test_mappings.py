"""What holds for every mapping: round trips, seams, solid angles, orientation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.support.reference_probe import MAPPINGS, mapping_of, random_directions

from lightwell.errors import MappingError
from lightwell.probe.cube import Cube
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.probe.octahedral import Octahedral
from lightwell.settings import MappingSettings

names = pytest.mark.parametrize("name", MAPPINGS)


def cone_angle(mapping: Mapping, directions: NDArray[Any]) -> NDArray[Any]:
    """Return the angle of directions from the blind cone's axis; π where there is no cone."""
    if mapping.blind_axis is None:
        return np.full(len(directions), math.pi)
    return np.arccos(np.clip(directions @ mapping.blind_axis, -1, 1))


@names
def test_direction_to_pixel_and_back(name: str) -> None:
    mapping = mapping_of(name)
    directions = random_directions(4000)
    x, y, seen = mapping.pixels(directions)
    outside = cone_angle(mapping, directions) > mapping.blind_half_angle + 1e-9
    assert np.array_equal(seen[outside], np.ones(outside.sum(), bool))
    assert not seen[cone_angle(mapping, directions) < mapping.blind_half_angle - 1e-9].any()
    back, visible = mapping.directions(x, y)
    assert visible[seen].all()
    assert np.abs(back - directions)[seen].max() < 1e-11
    assert mapping.sees(x, y)[seen].all()
    assert (x[seen] >= -1e-9).all()
    assert (x[seen] <= mapping.width + 1e-9).all()


@names
def test_pixel_to_direction_and_back(name: str) -> None:
    mapping = mapping_of(name)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, mapping.width, 3000), rng.uniform(0, mapping.height, 3000)
    directions, seen = mapping.directions(x, y)
    assert np.abs(np.linalg.norm(directions, axis=-1) - 1).max() < 1e-12
    back_x, back_y, visible = mapping.pixels(directions)
    assert visible[seen].all()
    assert np.hypot(back_x - x, back_y - y)[seen].max() < 1e-6


SEAMS = np.array(
    [
        [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0],
        [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0], [1, 0, 1], [0, 1, -1],
        [1, 1, 1], [-1, -1, -1], [1, -1, 1], [-1, 1, -1], [1, 0, -1e-12], [1, -1e-17, 0],
    ]
)  # fmt: skip
"""Poles, edges and corners of cubes and octahedra, and both sides of the lat-long's seam."""


@names
def test_seams(name: str) -> None:
    mapping = mapping_of(name)
    world_from_camera = getattr(mapping, "world_from_camera", np.eye(3))
    for directions in (SEAMS, SEAMS @ world_from_camera.T):
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        x, y, seen = mapping.pixels(unit)
        assert np.isfinite(x).all()
        assert np.isfinite(y).all()
        back, _ = mapping.directions(x, y)
        assert np.abs(back - unit)[seen].max() < 1e-7
        assert seen[cone_angle(mapping, unit) > mapping.blind_half_angle + 1e-9].all()


@names
def test_density_is_the_area_of_a_small_square_on_the_sphere(name: str) -> None:
    mapping = mapping_of(name)
    rng = np.random.default_rng(2)
    row0, row1, col0, col1 = mapping.region
    x, y = rng.uniform(col0, col1, 2000), rng.uniform(row0, row1, 2000)
    step = 1e-4
    corners = [(x - step, y - step), (x + step, y - step), (x + step, y + step), (x - step, y + step)]
    points, seen = zip(*(mapping.directions(*corner) for corner in corners), strict=True)
    inside = np.logical_and.reduce(seen)
    diagonals = np.cross(points[2] - points[0], points[3] - points[1])
    area = np.linalg.norm(diagonals, axis=-1) / 2 / (2 * step) ** 2
    # Away from the rim of a mirror sphere, where the density changes within the small square.
    smooth = inside & (mapping.density(x, y) < 50 * np.median(mapping.density(x, y)))
    ratio = area[smooth] / mapping.density(x, y)[smooth]
    assert smooth.sum() > 500
    assert np.median(np.abs(ratio - 1)) < 1e-6
    assert np.quantile(np.abs(ratio - 1), 0.98) < 1e-3


@names
def test_solid_angles_make_up_what_the_probe_sees(name: str) -> None:
    mapping = mapping_of(name)
    table = mapping.solid_angles()
    assert table.shape == (mapping.height, mapping.width)
    assert (table >= 0).all()
    assert table.sum() == pytest.approx(mapping.seen_solid_angle, rel=1e-12)
    assert mapping.seen_solid_angle == pytest.approx(2 * math.pi * (1 + math.cos(mapping.blind_half_angle)))


@names
def test_footprints_sum_to_the_solid_angles(name: str) -> None:
    mapping = mapping_of(name)
    total = np.zeros(mapping.height * mapping.width)
    for pixel, direction, solid_angle in mapping.footprints():
        assert np.abs(np.linalg.norm(direction, axis=1) - 1).max() < 1e-12
        total += np.bincount(pixel, solid_angle, total.size)
    assert total == pytest.approx(mapping.solid_angles().reshape(-1), rel=1e-9, abs=1e-15)
    assert (total > 0)[mapping.coverage().reshape(-1)].all()
    assert not total[~mapping.coverage().reshape(-1)].any(), "a pixel that mixes probe and background is read"


@names
def test_region_holds_every_pixel_that_is_read(name: str) -> None:
    mapping = mapping_of(name)
    row0, row1, col0, col1 = mapping.region
    table = mapping.solid_angles()
    assert np.count_nonzero(table[row0:row1, col0:col1]) == np.count_nonzero(table)
    assert table[row0].any()
    assert table[row1 - 1].any()
    assert table[:, col0].any()
    assert table[:, col1 - 1].any()


@names
def test_nearest_covered(name: str) -> None:
    mapping = mapping_of(name)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, mapping.width, 500), rng.uniform(0, mapping.height, 500)
    seen = mapping.sees(x, y)
    near_x, near_y = mapping.nearest_covered(x[seen], y[seen])
    covered = mapping.coverage()
    assert covered[near_y.astype(int), near_x.astype(int)].all()
    already = covered[y[seen].astype(int), x[seen].astype(int)]
    assert np.array_equal(near_x[already], x[seen][already])
    assert np.hypot(near_x - x[seen], near_y - y[seen]).max() < 2.5


def camera_mapping(kind: str, **options: Any) -> Mapping:
    return make_mapping(MappingSettings(kind=kind, **options), 100, 100)


@pytest.mark.parametrize(
    ("kind", "options", "centre"),
    [
        ("mirror-ball", {}, -1),
        ("mirror-sphere", {"sphere_radius_m": 0.1, "sphere_distance_m": 1.0, "disc": (50, 50, 50)}, -1),
        ("angular", {}, 1),
        ("fisheye", {"fov_degrees": 190}, 1),
    ],
)
def test_orientation_of_camera_pictures(kind: str, options: dict[str, Any], centre: int) -> None:
    """The centre looks forward (or back at the camera), right and top are right and up: nothing is mirrored."""
    forward, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    right = np.array([1.0, 0.0, 0.0])
    mapping = camera_mapping(kind, forward=tuple(forward), up=tuple(up), **options)
    direction, _ = mapping.directions(50, 50)
    assert direction == pytest.approx(centre * forward, abs=1e-12)
    for x, y, towards in ((80, 50, right), (20, 50, -right), (50, 20, up), (50, 80, -up)):
        direction, _ = mapping.directions(x, y)
        assert direction @ towards > 0.4
        assert abs(direction @ np.cross(towards, forward)) < 1e-12


def test_orientation_of_latlong_octahedral_and_cube() -> None:
    latlong = make_mapping(MappingSettings(), 90, 180)
    assert latlong.directions(0, 0)[0] == pytest.approx([0, 0, 1], abs=1e-12)
    assert latlong.directions(45, 45)[0] == pytest.approx([0, 1, 0], abs=1e-12)
    octahedral = make_mapping(MappingSettings(kind="octahedral"), 90, 90)
    assert octahedral.directions(45, 45)[0] == pytest.approx([0, 0, 1], abs=1e-12)
    assert octahedral.directions(90, 45)[0] == pytest.approx([1, 0, 0], abs=1e-12)
    assert octahedral.directions(45, 0)[0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert octahedral.directions(0, 0)[0] == pytest.approx([0, 0, -1], abs=1e-12)
    strip = Cube(10, 60)
    for face, outwards in enumerate(np.repeat(np.eye(3), 2, axis=0) * np.array([[1], [-1]] * 3)):
        assert strip.directions(10 * face + 5, 5)[0] == pytest.approx(outwards, abs=1e-12)
    # OpenGL 4.6, table 8.19: on face +X, s runs along −z and t along −y.
    assert strip.directions(10 - 1e-9, 5)[0] @ [1, 0, -1] == pytest.approx(math.sqrt(2))
    assert strip.directions(5, 0)[0] @ [1, 1, 0] == pytest.approx(math.sqrt(2))


@pytest.mark.parametrize("shape", [(30, 40), (40, 30)])
def test_crosses_are_seamless(shape: tuple[int, int]) -> None:
    """Walking over the fold between neighbouring faces of a cross, the direction does not jump."""
    cube = Cube(*shape)
    for x, y in ((10, 15), (20, 15), (15, 10), (15, 20), *(((30, 15),) if shape == (30, 40) else ((15, 30),))):
        steps = [(1e-6, 0), (-1e-6, 0)] if x % 10 == 0 else [(0, 1e-6), (0, -1e-6)]
        one, other = (cube.directions(x + dx, y + dy)[0] for dx, dy in steps)
        assert np.abs(one - other).max() < 1e-5
    assert cube.coverage().sum() == 600


def test_exact_solid_angles() -> None:
    latlong = make_mapping(MappingSettings(), 32, 64).solid_angles()
    assert latlong.sum() == pytest.approx(4 * math.pi, rel=1e-15)
    cube = Cube(250, 1500).solid_angles()
    for size in (3, 8, 25):
        octahedral = Octahedral(size, size)
        x, y = octahedral.pixel_centres()
        assert octahedral.solid_angles().sum() == pytest.approx(4 * math.pi, rel=1e-13)
        if size == 25:
            assert octahedral.solid_angles() == pytest.approx(octahedral.density(x, y), rel=0.15)
    assert cube.sum() == pytest.approx(4 * math.pi, rel=3e-14)
    assert cube[:, :250].sum() == pytest.approx(4 * math.pi / 6, rel=1e-14)
    ball = camera_mapping("mirror-ball")
    inner = ball.coverage().copy()
    inner[:8], inner[-8:], inner[:, :8], inner[:, -8:] = False, False, False, False
    centre = ball.solid_angles()[40:60, 40:60]
    assert centre == pytest.approx(np.full((20, 20), 4 / 50**2), rel=1e-12), "J = 4 on the unit disc"


@pytest.mark.parametrize(
    ("settings_of", "height", "width", "message"),
    [
        ({"kind": "cube"}, 100, 100, "is no cube map"),
        ({"kind": "octahedral"}, 100, 101, "square"),
        ({"kind": "fisheye"}, 100, 100, "--fov-degrees"),
        ({"kind": "mirror-ball", "disc": (500, 5, 5)}, 100, 100, "outside the picture"),
        ({"kind": "mirror-ball", "disc": (50, 50, 1)}, 100, 100, "too small"),
        ({"kind": "angular", "disc": (50, 50, -1)}, 100, 100, "radius must be positive"),
        ({"kind": "angular", "forward": (0, 0, 1), "up": (0, 0, 2)}, 100, 100, "--forward and --up"),
        ({"kind": "latlong"}, 0, 100, "no pixels"),
    ],
)
def test_what_cannot_be_a_mapping(settings_of: dict[str, Any], height: int, width: int, message: str) -> None:
    with pytest.raises(MappingError, match=message):
        make_mapping(MappingSettings.model_validate(settings_of), height, width)


def test_keys_tell_mappings_apart() -> None:
    keys = {mapping_of(name).key for name in MAPPINGS}
    assert len(keys) == len(MAPPINGS)
    assert all(mapping_of(name).key in keys for name in MAPPINGS)


@settings(max_examples=30, deadline=None)
@given(
    azimuth=st.floats(0, 2 * math.pi),
    height=st.floats(-1, 1),
    name=st.sampled_from(sorted(MAPPINGS)),
)
def test_round_trip_of_any_direction(azimuth: float, height: float, name: str) -> None:
    mapping = mapping_of(name)
    across = math.sqrt(1 - height * height)
    direction = np.array([across * math.cos(azimuth), across * math.sin(azimuth), height])
    x, y, seen = mapping.pixels(direction)
    if seen:
        assert mapping.directions(x, y)[0] == pytest.approx(direction, abs=1e-7)


def test_the_field_of_a_fisheye_is_across_the_width() -> None:
    for lens, halfway in (("equidistant", 45.0), ("equisolid", math.degrees(2 * math.asin(math.sin(math.pi / 4) / 2)))):
        mapping = make_mapping(MappingSettings(kind="fisheye", fov_degrees=180, fisheye=lens), 180, 320)
        for x, degrees in ((160.0, 0.0), (240.0, halfway), (320.0, 90.0)):
            direction, seen = mapping.directions(x, 90.0)
            assert seen
            assert math.degrees(math.acos(np.clip(-direction[2], -1, 1))) == pytest.approx(degrees, abs=1e-6)
    small = make_mapping(MappingSettings(kind="fisheye", fov_degrees=180, disc=(160, 90, 80)), 180, 320)
    assert small.blind_half_angle == pytest.approx(math.pi * 3 / 4), "the disc is half as wide as the picture"
    with pytest.raises(MappingError, match="further than straight back"):
        make_mapping(MappingSettings(kind="fisheye", fov_degrees=300, disc=(160, 90, 200)), 180, 320)


@pytest.mark.parametrize("disc", [(32.0, 32.0, 1e300), (32.0, 32.0, 1000.0)])
def test_absurd_discs_are_refused(disc: tuple[float, float, float]) -> None:
    with pytest.raises(MappingError, match="far larger than the picture"):
        make_mapping(MappingSettings(kind="angular", disc=disc), 64, 64)
