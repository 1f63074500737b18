"""On which side of a plane a point lies, against rational arithmetic and libigl; crossings that depend on it."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import igl.predicates
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.base.native import ffi, lib
from crease.mesh import topology
from hypothesis import given, settings
from hypothesis import strategies as st

F64 = npt.NDArray[np.float64]


def side(points: F64) -> int:
    """cr_exact_side of four points (4, 3)."""
    rows = [ffi.new("double[3]", row.tolist()) for row in points]
    return int(lib.cr_exact_side(*rows))


def rational_side(points: F64) -> int:
    """The same in rational arithmetic."""
    a, *rest = [[Fraction(x) for x in row] for row in points.tolist()]
    u, v, w = ([p - q for p, q in zip(row, a, strict=True)] for row in rest)
    value = sum(
        u[k] * (v[(k + 1) % 3] * w[(k + 2) % 3] - v[(k + 2) % 3] * w[(k + 1) % 3]) for k in range(3)
    )
    return (value > 0) - (value < 0)


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2**32), st.sampled_from([0, 1e-17, 1e-16, 3e-16, 1e-12, 1.0]))
def test_side_is_that_of_rational_arithmetic(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4, 3)) * 10.0 ** rng.integers(-3, 3)
    s, t = rng.random(2)
    points[3] = points[0] + s * (points[1] - points[0]) + t * (points[2] - points[0])
    points[3] += noise * rng.normal(size=3)
    assert side(points) == rational_side(points)


def test_side_of_a_grid_round_a_plane_is_that_of_libigl() -> None:
    """Kettner's grid: a point moved by single bits across a plane through far points, where plain doubles are noise."""
    step = 2.0**-53
    plane = np.array([[12.0, 12.0, 1.0], [24.0, 24.0, 2.0], [0.5, 0.7, -3.0]])
    grid = np.array(
        [[0.5 + i * step, 0.5 + j * step, 1 / 24] for i in range(32) for j in range(32)]
    )
    ours = [side(np.vstack([plane, point])) for point in grid]
    theirs = igl.predicates.orient3d(plane[:1].repeat(len(grid), 0), plane[1:2].repeat(len(grid), 0),
                                     plane[2:].repeat(len(grid), 0), grid)  # fmt: skip
    # Shewchuk's orient3d is positive where ours is negative.
    assert ours == (-np.asarray(theirs)).reshape(-1).astype(int).tolist()
    assert len(set(ours)) > 1


def rational_crossings(vertices: F64, triangles: npt.NDArray[Any]) -> int:
    """Pairs of triangles of which an edge of one has its ends on both sides of the other and passes within its rim."""
    found = 0
    for i in range(len(triangles)):
        for j in range(i):
            boxes = vertices[[triangles[i], triangles[j]]]
            apart = boxes.min(axis=1).max(axis=0) > boxes.max(axis=1).min(axis=0)
            if apart.any() or len(set(triangles[i]) & set(triangles[j])) > 1:
                continue
            found += any(
                _edge_passes(vertices, one, k, two)
                for one, two in ((triangles[i], triangles[j]), (triangles[j], triangles[i]))
                for k in range(3)
            )
    return found


def _edge_passes(vertices: F64, edge_of: Any, k: int, through: Any) -> bool:
    ends = [edge_of[k], edge_of[(k + 1) % 3]]
    if set(ends) & set(through):
        return False
    p, q = vertices[ends]
    rim = vertices[through]
    heights = [rational_side(np.vstack([rim, end])) for end in (p, q)]
    turns = [rational_side(np.vstack([p, q, rim[m], rim[(m + 1) % 3]])) for m in range(3)]
    return heights[0] * heights[1] < 0 and (min(turns) >= 0 or max(turns) <= 0)


@pytest.mark.parametrize("slope", [1e-3, 1e-5, 5e-6])
def test_a_shallow_edge_that_misses_the_rim_by_far_does_not_cross(slope: float) -> None:
    """An edge 2 m long dips through a plane 0.2 m beside a triangle: the rim's tolerance once grew with the length."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0],
                         [-0.5, -0.2, slope], [1.5, -0.2, -slope], [0.5, 0.5, 1.0]])  # fmt: skip
    triangles = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    assert rational_crossings(vertices, triangles) == 0
    assert topology.self_intersections(vertices, triangles, 2e-6)[0] == 0


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(st.integers(0, 10_000))
def test_crossing_counts_are_those_of_rational_arithmetic(seed: int) -> None:
    """A ball with shaken vertices, flattened so that its edges are shallow."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(1)
    vertices = ball.vertices * [1.0, 1.0, 10.0 ** -rng.integers(0, 4)]
    vertices += 0.15 * rng.normal(size=vertices.shape) * np.ptp(vertices, axis=0)
    triangles = np.asarray(ball.faces, np.int32)
    count, _ = topology.self_intersections(vertices, triangles, 0.0)
    assert count == rational_crossings(vertices, triangles)
