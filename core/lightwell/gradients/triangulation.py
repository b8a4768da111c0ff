"""Delaunay simplices of a few points in one, two or three dimensions. Needs no more than numpy.

Delaunay simplices are the lower hull of the points lifted by their squared length. The first is found by the simplex
method, the others by gift wrapping over its facets. The lift has a tiny part that differs from point to point, so that
points on a common sphere, as those of a regular grid, have one answer. Work grows with the number of simplices times
that of points: 20 ms for 64 points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

FLAT = 1e-7
"""Distances from a facet, in units of the points' extent, that count as none."""
LIFT = 1e-6
"""Largest lift, in units of the extent squared."""


class Triangulation(NamedTuple):
    """Simplices of n points in d dimensions, and the facets of their hull."""

    simplices: Indices
    """``(simplices, d + 1)``."""
    hull: Indices
    """``(facets, d)``: facets that belong to one simplex only."""


def triangulate(points: Floats) -> Triangulation:
    """Return the Delaunay simplices of points ``(n, d)``, d = 1, 2 or 3, that span all d dimensions.

    Raises
    ------
    ValueError
        Where the points do not span d dimensions.
    """
    count, dimension = points.shape
    extent = float(np.ptp(points, axis=0).max()) if count else 0.0
    if count <= dimension or extent == 0:
        raise ValueError(f"{count} points do not span {dimension} dimensions")
    places = (points - points.mean(axis=0)) / extent
    number = np.arange(1, count + 1)
    lift = LIFT * np.modf(number * number * 0.6180339887498949)[0]  # of no pattern that a grid's numbers follow
    heights = np.sum(places * places, axis=1) + lift
    lifted = np.concatenate([places, np.ones((count, 1))], axis=1)
    simplices: set[tuple[int, ...]] = set()
    uses: dict[tuple[int, ...], int] = {}
    todo = [_first_simplex(lifted, heights)]
    while todo:
        simplex = todo.pop()
        if simplex in simplices:
            continue
        simplices.add(simplex)
        corners = _next_corners(lifted, heights, simplex)
        for apex, corner in zip(simplex, corners, strict=True):
            facet = tuple(k for k in simplex if k != apex)
            uses[facet] = uses.get(facet, 0) + 1
            if corner >= 0:
                todo.append(tuple(sorted((*facet, corner))))
    hull = [facet for facet, used in sorted(uses.items()) if used == 1]
    return Triangulation(np.array(sorted(simplices), np.intp), np.array(hull, np.intp).reshape(-1, dimension))


def _next_corners(lifted: Floats, heights: Floats, simplex: tuple[int, ...]) -> list[int]:
    """Return for each corner the point that makes a simplex with the facet across it; −1 beyond the hull.

    The plane through the simplex's lifted points may turn about those of a facet. The next simplex is that with the
    least turn, since all other points then lie above the plane: the least height over the plane for the distance
    beyond the facet, which is the corner's barycentric coordinate, negative there.
    """
    corners = list(simplex)
    inverse = np.linalg.inv(lifted[corners].T)
    coordinates = lifted @ inverse.T
    rise = heights - coordinates @ heights[corners]
    altitude = 1 / np.linalg.norm(inverse[:, :-1], axis=1)
    beyond = -coordinates > FLAT / altitude
    turn = np.where(beyond, rise[:, None] / np.where(beyond, -coordinates, 1), np.inf)
    return [int(k) if found else -1 for k, found in zip(np.argmin(turn, axis=0), beyond.any(axis=0), strict=True)]


def _first_simplex(lifted: Floats, heights: Floats) -> tuple[int, ...]:
    """Return the Delaunay simplex round a point, by the simplex method: lowest lifted height over all convex sums."""
    corners = _spread(lifted[:, :-1])
    shares = 1 + 1e-3 * np.arange(1, len(corners) + 1)  # no two alike: no facet passes through the point
    aim = (shares / shares.sum()) @ lifted[corners]
    while True:
        inverse = np.linalg.inv(lifted[corners].T)
        weights = inverse @ aim
        below = heights - (lifted @ inverse.T) @ heights[corners]
        below[corners] = 0
        enters = int(np.argmin(below))
        if below[enters] > -1e-12:
            return tuple(sorted(int(k) for k in corners))
        moves = inverse @ lifted[enters]
        ratio = np.where(moves > 1e-12, weights / np.where(moves > 1e-12, moves, 1), np.inf)
        corners[int(np.argmin(ratio))] = enters


def _spread(places: Floats) -> Indices:
    """Return d + 1 points far apart that span all d dimensions."""
    corners = [0]
    rest = places - places[0]
    for _ in range(places.shape[1]):
        corners.append(int(np.argmax(np.sum(rest * rest, axis=1))))
        length = float(np.linalg.norm(rest[corners[-1]]))
        if length < FLAT:
            raise ValueError(f"the points do not span {places.shape[1]} dimensions")
        axis = rest[corners[-1]] / length
        rest = rest - np.outer(rest @ axis, axis)
    return np.array(corners, np.intp)
