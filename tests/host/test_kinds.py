"""Distances from the planes of a corner, as the bake asks for them (host/native/surface/solid.c)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from crease.bake.kinds import CORNERS_FEW, SHORT_ONE, Probes, distance_from_planes, rectangles

F64 = npt.NDArray[np.float64]

EDGES_M = np.array([0.01, -0.02, 0.03])
PLANES = np.column_stack([np.eye(3), EDGES_M])
"""A corner: the solid is where each coordinate is below that of EDGES_M."""


def points(count: int = 3000) -> F64:
    return np.asarray(EDGES_M + np.random.default_rng(8).uniform(-0.02, 0.02, (count, 3)))


def of_corner(at: F64) -> F64:
    """Signed distance to the corner: nearest is a face, an edge or the vertex."""
    above = at - EDGES_M
    outside = np.linalg.norm(np.maximum(above, 0.0), axis=1)
    return np.asarray(np.where((above > 0).any(axis=1), outside, above.max(axis=1)))


def test_planes_give_the_distance_to_a_corner_and_to_its_complement() -> None:
    at = points()
    np.testing.assert_allclose(distance_from_planes(1.0, PLANES, at), of_corner(at), atol=1e-15)
    outside = np.column_stack([-np.eye(3), -EDGES_M])
    np.testing.assert_allclose(distance_from_planes(-1.0, outside, at), -of_corner(at), atol=1e-15)
    np.testing.assert_allclose(
        distance_from_planes(1.0, PLANES[:1], at), at[:, 0] - EDGES_M[0], atol=1e-15
    )


def test_planes_of_a_sharp_oblique_wedge_give_the_distance_to_its_edge() -> None:
    turn = np.radians(25.0)
    planes = np.array(
        [[0.0, np.sin(turn), np.cos(turn), 0.0], [0.0, np.sin(turn), -np.cos(turn), 0.0]]
    )
    at = np.array([[0.004, 0.003, 0.0], [-0.001, 0.002, 1e-4]])
    np.testing.assert_allclose(
        distance_from_planes(1.0, planes, at), np.hypot(at[:, 1], at[:, 2]), rtol=1e-12
    )


@pytest.mark.parametrize(("off_m", "kept"), [(0.9e-6, 5), (1.1e-6, 4)])
def test_rows_of_probes_agree_when_none_of_them_is_off(off_m: float, kept: int) -> None:
    at = points(5 * 40).reshape(5, 40, 3)
    exact = of_corner(at.reshape(-1, 3)).reshape(5, 40)
    near = np.abs(exact) < 5e-3
    exact[3, np.flatnonzero(near[3])[-1]] += off_m
    exact[2, np.flatnonzero(~near[2])[0]] += 5e-6
    probes = Probes(at, exact, 5e-3, 1e-6, 1e-5)
    assert len(probes.agreeing(1.0, PLANES, np.arange(5))) == kept
    assert probes.agreeing(-1.0, PLANES, np.array([4, 1])).tolist() == []


def rectangle(normal: F64, points_m: F64) -> tuple[F64, F64, F64]:
    """Of one set of points: direction, from where, to where."""
    along, low, high = rectangles(normal[None], points_m[None])
    return along[0] / SHORT_ONE, low[0], high[0]


def sides_m(low_m: F64, high_m: F64) -> F64:
    return np.asarray(np.sort(high_m - low_m))


def test_the_rectangle_of_a_facet_holds_it_and_is_that_of_least_girth() -> None:
    rng = np.random.default_rng(5)
    for count in (4, CORNERS_FEW - 4, CORNERS_FEW, 3000):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        half, shift = rng.uniform(1e-3, 2e-2, 2), rng.uniform(-0.1, 0.1, 3)
        inside = rng.uniform(-1.0, 1.0, (count, 2)) * half
        flat = np.vstack([inside, half * [[1, 1], [1, -1], [-1, 1], [-1, -1]]])
        points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T + shift
        side, low, high = rectangle(turn[:, 2], points)
        assert abs(np.linalg.norm(side) - 1.0) < 5e-5
        assert abs(side @ turn[:, 2]) < 5e-5
        # As far as the direction is rounded, which turns the other side by as much.
        np.testing.assert_allclose(sides_m(low, high), np.sort(2.0 * half), atol=5e-6)
        at = points @ np.column_stack([side, np.cross(turn[:, 2], side)])
        assert ((at >= low - 1e-12) & (at <= high + 1e-12)).all()


def test_the_rectangle_of_a_triangle_does_not_depend_on_how_it_lies() -> None:
    """Of the three along its sides, all of one area."""
    corners = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.01, 0.02, 0.0]])
    rng = np.random.default_rng(6)
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        low, high = rectangle(turn[:, 2], corners @ turn.T)[1:]
        wanted = [1e-2 * 5**0.5, 6e-2 * 5**-0.5]
        np.testing.assert_allclose(sides_m(low, high), wanted, atol=5e-6)


@pytest.mark.parametrize("count", [3, CORNERS_FEW + 1])
def test_the_rectangle_of_a_sliver_is_its_line(count: int) -> None:
    share = np.concatenate([[0.0, 1.0], np.linspace(0.1, 0.9, count - 2)])
    line = np.array([0.5, 0.0, 0.0]) + np.outer(share, [0.0, 0.01, 0.0])
    along, low, high = rectangle(np.array([0.0, 0.0, 1.0]), line)
    np.testing.assert_allclose(np.abs(along), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(sides_m(low, high), [0.0, 0.01], atol=1e-15)
    np.testing.assert_allclose(np.abs(low + high), [0.01, 1.0], atol=1e-15)


def test_one_place_has_a_rectangle_too() -> None:
    for count in (3, CORNERS_FEW + 1):
        along, low, high = rectangle(np.array([0.0, 0.0, 1.0]), np.full((count, 3), 0.01))
        assert np.linalg.norm(along) > 0.9999
        np.testing.assert_allclose(high - low, 0.0, atol=1e-15)


def test_rectangles_of_few_corners_are_those_of_their_hull() -> None:
    """All ways from corner to corner, and the sides of the hull alone: none of the others is better."""
    rng = np.random.default_rng(9)
    points = rng.normal(size=(200, 12, 3)) * [0.02, 0.01, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (200, 1))
    _, low, high = rectangles(normals, points)
    many = np.concatenate([points, np.repeat(points[:, :1], CORNERS_FEW, axis=1)], axis=1)
    _, low_hull, high_hull = rectangles(normals, many)
    np.testing.assert_allclose(
        (high - low).sum(axis=1), (high_hull - low_hull).sum(axis=1), atol=5e-6
    )
