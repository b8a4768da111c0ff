"""Meshes, and rays against them."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from tests.support.shapes import quad, sphere

from lightwell.geometry.mesh import front_normals, make_mesh, vertex_normals
from lightwell.geometry.rays import RayScene

UP = np.array([[0, 0, 1]], np.float32)


def square(name: str, z: float) -> list[list[float]]:
    del name
    return [[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]]


def test_hits_name_mesh_triangle_place_and_distance() -> None:
    scene = RayScene([quad(square("a", 1)), make_mesh("empty", [[0, 0, 0]], []), quad(square("b", 2))])
    origins = np.array([[0.5, 0.2, 0], [0.5, 0.2, 1.5], [0.5, 0.2, 3], [0.2, 0.7, 1.25]], np.float32)
    hits = scene.intersect(origins, UP)
    assert hits.mesh.tolist() == [0, 2, -1, 2]
    assert hits.triangle.tolist() == [0, 0, -1, 1]
    np.testing.assert_allclose(hits.distance, [1, 0.5, np.inf, 0.75])
    assert scene.occluded(origins, UP).tolist() == [True, True, False, True]
    for index, (mesh, triangle, (u, v)) in enumerate(zip(hits.mesh, hits.triangle, hits.barycentric, strict=True)):
        if mesh >= 0:
            a, b, c = scene.meshes[mesh].positions[scene.meshes[mesh].triangles[triangle]]
            point = (1 - u - v) * a + u * b + v * c
            np.testing.assert_allclose(point, origins[index] + hits.distance[index] * UP[0], atol=1e-6)


def test_scenes_without_triangles_and_batches_without_rays() -> None:
    empty = RayScene([make_mesh("empty", [[0, 0, 0]], [])])
    assert empty.occluded(np.zeros((3, 3), np.float32), UP).tolist() == [False] * 3
    assert empty.intersect(np.zeros((3, 3), np.float32), UP).mesh.tolist() == [-1] * 3
    some = RayScene([sphere()])
    assert len(some.occluded(np.zeros((0, 3), np.float32), UP)) == 0
    assert RayScene([]).occluded(np.zeros((1, 3), np.float32), UP).tolist() == [False]


def test_rays_that_end_meet_nothing_beyond() -> None:
    scene = RayScene([quad([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]])])
    origins, up = np.zeros((4, 3), np.float32), np.array([[0, 0, 4]], np.float32).repeat(4, 0)
    ends = np.array([0.49, 0.51, 1e30, 0], np.float32)
    assert scene.occluded(origins, up, ends).tolist() == [False, True, True, False]


def test_threads_may_share_a_scene() -> None:
    scene = RayScene([sphere(60, 90)])
    random = np.random.default_rng(1)
    origins = (random.normal(size=(20_000, 3)) * 2).astype(np.float32)
    directions = random.normal(size=(20_000, 3)).astype(np.float32)
    expected = scene.occluded(origins, directions)
    found: list[bool] = []

    def work() -> None:
        found.append(bool((scene.occluded(origins, directions) == expected).all()))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [True] * 4


def test_fronts_are_where_the_vertex_normals_point() -> None:
    mesh = make_mesh("flap", [[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 1]], [[0, 0, -1]] * 3)
    normals, areas = front_normals(mesh)
    np.testing.assert_array_equal(normals, [[0, 0, -1], [0, 0, -1]])
    np.testing.assert_array_equal(areas, [2, 2])


def test_normals_do_not_depend_on_how_polygons_are_cut() -> None:
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[f[0], f[1], f[2]] for f in faces] + [[f[0], f[2], f[3]] for f in faces], np.int32)
    expected = (cube - 0.5) / np.linalg.norm(cube - 0.5, axis=1, keepdims=True)
    np.testing.assert_allclose(vertex_normals(cube, triangles), expected, atol=1e-6)
    flipped = triangles.copy()
    flipped[::2] = flipped[::2, ::-1]
    found = vertex_normals(cube, flipped, towards=expected.astype(np.float32))
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("positions", "triangles", "words"),
    [
        (np.zeros((0, 3)), [], "at least one vertex"),
        (np.zeros((3, 2)), [[0, 1, 2]], r"\(V, 3\)"),
        (
            [[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]],
            [[0, 1, 2]],
            "1 of 3 vertices are not finite numbers, the first is number 1",
        ),
        (np.zeros((3, 3)), [[0, 1, 3]], r"name vertices 0 … 3, but there are 3"),
        (np.zeros((3, 3)), [[0, 1, -1]], "name vertices -1 … 1"),
        (np.zeros((3, 3)), [[0, 1]], r"\(F, 3\)"),
    ],
)
def test_mistakes_are_named(positions: object, triangles: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make_mesh("bad", positions, triangles)  # type: ignore[arg-type]
