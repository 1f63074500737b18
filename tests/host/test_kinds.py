"""Distances from the planes of a corner, as the bake asks for them (host/native/surface/solid.c)."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import numpy as np
import numpy.typing as npt
import pytest
from crease.bake.kinds import (
    CORNERS_FEW,
    SHORT_ONE,
    Kinds,
    Probes,
    distance_from_planes,
    rectangles,
)
from crease.bake.surface import make_surface
from crease.mesh.mesh import make_mesh

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


def ends_of(outline_mm: Sequence[tuple[float, float]], reach_m: float = 1e-3) -> list[set[str]]:
    """Where the faces of a prism, 40 mm along y, of an outline in x and z, counter-clockwise seen from -y, end: of each
    side of the outline, as "y", "start" and "end" of it.
    """
    shape = manifold3d.CrossSection([[(x, z) for x, z in outline_mm]]).extrude(40.0).to_mesh()
    x, z, y = np.asarray(shape.vert_properties, np.float64)[:, :3].T
    vertices = np.column_stack([x, 20.0 - y, z])
    surface = make_surface(
        make_mesh(vertices, np.asarray(shape.tri_verts), 1e-3, source="prism"), 30.0
    )
    kinds = Kinds(surface)
    for facet in range(len(surface.facet_plane)):
        kinds.planar(facet)
    planes = kinds.records(reach_m)[1]
    found = []
    for i, start in enumerate(outline_mm):
        way = np.subtract(outline_mm[(i + 1) % len(outline_mm)], start)
        way = np.array([way[0], 0.0, way[1]]) / np.linalg.norm(way)
        normal, point = np.array([way[2], 0.0, -way[0]]), 1e-3 * np.array([start[0], 0.0, start[1]])
        (row,) = [
            p
            for p in planes
            if p["normal"] @ normal > 0.9999 and abs(normal @ point - p["offset_m"]) < 1e-6
        ]
        along = row["along"] / SHORT_ONE
        across = np.cross(row["normal"], along)
        outward = [-along, along, -across, across]
        mine: set[str] = set()
        for side, out in enumerate(outward):
            if row["ends"] >> side & 1:
                mine.add("y" if abs(out[1]) > 0.9 else "end" if out @ way > 0.0 else "start")
        found.append(mine)
    return found


ALL = {"y", "start", "end"}


def test_faces_of_a_box_end_on_all_sides() -> None:
    assert ends_of([(0, 0), (60, 0), (60, 20), (0, 20)]) == [ALL] * 4


def test_a_floor_does_not_end_where_a_wall_stands_on_it() -> None:
    step = [(0, 0), (60, 0), (60, 10), (30, 10), (30, 30), (0, 30)]
    assert ends_of(step) == [ALL, ALL, {"y", "start"}, {"y", "end"}, ALL, ALL]


@pytest.mark.parametrize(
    ("turn_deg", "ends"), [(10.0, False), (29.0, False), (31.0, True), (80.0, True)]
)
def test_a_face_ends_where_it_bends_by_more_than_thirty_degrees(
    turn_deg: float, ends: bool
) -> None:
    drop = 30.0 * np.tan(np.radians(turn_deg)) if turn_deg < 60.0 else 0.0
    end = (60.0, 60.0 - drop) if drop else (30.0 + 30.0 / np.tan(np.radians(turn_deg)), 30.0)
    bent = [(0.0, 0.0), (end[0], 0.0), end, (30.0, 60.0), (0.0, 60.0)]
    top, slope = ends_of(bent)[3], ends_of(bent)[2]
    assert ("start" in top) == ends
    assert ("end" in slope) == ends
    assert {"y", "end"} <= top


def test_a_face_that_is_bordered_in_part_ends_where_most_of_the_side_does() -> None:
    """A wall on 18 of 40 mm of the side of a floor lets it end there, on 22 it does not."""
    for width, ends in ((18.0, True), (22.0, False)):
        floor = manifold3d.Manifold.cube((60.0, 40.0, 10.0))
        wall = manifold3d.Manifold.cube((5.0, width, 30.0)).translate((60.0, 0.0, 0.0))
        made = (floor + wall).to_mesh()
        vertices = np.asarray(made.vert_properties, np.float64)[:, :3]
        surface = make_surface(
            make_mesh(vertices, np.asarray(made.tri_verts), 1e-3, source="floor"), 30.0
        )
        kinds = Kinds(surface)
        for facet in range(len(surface.facet_plane)):
            kinds.planar(facet)
        planes = kinds.records(1e-3)[1]
        (row,) = [p for p in planes if p["normal"][2] > 0.9999 and abs(p["offset_m"] - 0.01) < 1e-6]
        along = row["along"] / SHORT_ONE
        outward = np.array(
            [-along, along, -np.cross(row["normal"], along), np.cross(row["normal"], along)]
        )
        assert bool(row["ends"] >> int(np.argmax(outward[:, 0])) & 1) == ends
