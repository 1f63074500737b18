"""Surfaces that touch themselves: what is inside there, and that nothing is felt where nothing is."""

from __future__ import annotations

import igl
import numpy as np
import parts
import pytest
import trimesh
from crease.bake.surface import Surface, make_surface
from crease.mesh import topology
from crease.mesh.mesh import make_mesh
from crease.mesh.topology import touching, without_leaves
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def wedge(turn_rad: float) -> trimesh.Trimesh:
    """A prism of 20 mm whose edge of 30 degrees is the z axis, pointing along -x when not turned."""
    half = np.tan(np.radians(15.0)) * 10.0
    corners = np.array([(0.0, 0.0), (10.0, -half), (10.0, half)])
    points = np.array([(x, y, z) for z in (-10.0, 10.0) for x, y in corners])
    faces = [
        (2, 1, 0),
        (3, 4, 5),
        (0, 1, 4),
        (0, 4, 3),
        (1, 2, 5),
        (1, 5, 4),
        (2, 0, 3),
        (2, 3, 5),
    ]
    turned = trimesh.Trimesh(points, faces, process=False)
    turned.apply_transform(trimesh.transformations.rotation_matrix(turn_rad, (0, 0, 1)))
    return turned


def test_two_wedges_that_share_an_edge_have_nothing_between_them() -> None:
    """Most of what is round the edge is nearest to it, and its normals cancel: by them half would be inside."""
    both = trimesh.util.concatenate([wedge(0.0), wedge(2.0)])
    both.merge_vertices()
    mesh = make_mesh(both.vertices, both.faces, 1e-3, source="wedges")
    surface = make_surface(mesh, 30.0)
    angle = np.linspace(0.0, 2 * np.pi, 720, endpoint=False) + 1e-3
    points = 3.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    inside = np.zeros(len(angle), bool)
    for middle in (0.0, 2.0):
        away = np.abs((angle - middle + np.pi) % (2 * np.pi) - np.pi)
        inside |= away < np.radians(15.0)
    phi_m, _ = surface.signed_distance(1e-3 * points)
    np.testing.assert_array_equal(phi_m < 0.0, inside)
    assert surface.doubtful.any()
    assert surface.winding is not None


def test_a_closed_surface_that_touches_itself_nowhere_is_asked_no_winding_number() -> None:
    ball = trimesh.creation.icosphere(3, radius=10.0)
    surface = make_surface(make_mesh(ball.vertices, ball.faces, 1e-3, source="ball"), 30.0)
    assert not surface.doubtful.any()
    assert surface.winding is None


def test_a_shared_corner_is_found() -> None:
    box = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    other = box.copy()
    other.apply_translation((2.0, 2.0, 2.0))
    both = trimesh.util.concatenate([box, other])
    both.merge_vertices()
    found = touching(both.faces.astype(np.int32), len(both.vertices))
    at_corner = (np.abs(both.vertices[both.faces] - 1.0) < 1e-9).all(axis=2).any(axis=1)
    np.testing.assert_array_equal(found, at_corner)


def test_leaves_fall_in_pairs() -> None:
    triangles = [(0, 1, 2), (1, 2, 0), (2, 1, 0), (3, 4, 5), (6, 7, 8), (8, 7, 6)]
    left = without_leaves(np.array(triangles, np.int32))
    assert left.tolist() in ([[0, 1, 2], [3, 4, 5]], [[1, 2, 0], [3, 4, 5]])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bone", "knob", "impeller"])
def test_what_decimating_left_has_the_inside_that_its_triangles_wind_round(
    name: str,
) -> None:
    """A leaf on the bone turned the sign of what is up to 24 mm away: a ball felt 7 N in free space."""
    spoiled = parts.SPOILERS["decimated"](parts.PARTS[name]())
    mesh = make_mesh(spoiled.vertices, spoiled.faces, 1e-3, source=name)
    vertices, triangles = 1e3 * mesh.vertices_m, mesh.triangles.astype(np.int64)
    low, high = vertices.min(axis=0) - 3.0, vertices.max(axis=0) + 3.0
    points: Floats = low + (high - low) * np.random.default_rng(0).random((60_000, 3))
    phi_m, _ = make_surface(mesh, 30.0).signed_distance(1e-3 * points)
    winding = igl.fast_winding_number(np.ascontiguousarray(vertices), triangles, points)
    np.testing.assert_array_equal(phi_m < 0.0, winding > 0.5)


def voxels(seed: int, side: int, filled: float) -> NDArray[np.bool_]:
    return np.random.default_rng(seed).random((side,) * 3) < filled


def skin(filled: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.int64]]:
    """The faces of voxels towards empty ones, as every voxel tool writes them; the first diagonal of each is cut."""
    padded, corners = np.pad(filled, 1), []
    for axis in range(3):
        u, w = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for sense in (1, -1):
            at = np.argwhere(padded & ~np.roll(padded, -sense, axis)) - 1.0
            at[:, axis] += sense > 0
            corners.append(np.stack([at, at + u, at + u + w, at + w][::sense], axis=1))
    quads = np.concatenate(corners)
    faces = (4 * np.arange(len(quads))[:, None, None] + [(0, 1, 2), (0, 2, 3)]).reshape(-1, 3)
    return quads.reshape(-1, 3).astype(np.float64), np.asarray(faces, np.int64)


def wrong_voxels(surface: Surface, filled: NDArray[np.bool_], first: float = 0.0) -> int:
    """Points in voxels of 10 mm, from `first` voxels on, that are taken for the wrong side; half are near corners."""
    points = np.random.default_rng(3).random((40_000, 3)) * filled.shape[0]
    points[::2] = np.round(points[::2]) + np.random.default_rng(4).normal(0.0, 1e-3, (20_000, 3))
    points = points[(np.abs(points - np.round(points)) > 1e-4).all(axis=1)]
    padded = np.pad(filled, 1)
    inside = padded[tuple((np.floor(points).astype(int) + 1).T)]
    return int(
        np.count_nonzero((surface.signed_distance(1e-2 * (points + first))[0] < 0.0) != inside)
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("filled", [0.3, 0.5])
def test_a_skin_of_voxels_stays_as_it_is(seed: int, filled: float) -> None:
    """Voxels that touch in edges, of one shell or of two: manifold3d joined them across the material."""
    solid = voxels(seed, 8, filled)
    mesh = make_mesh(*skin(solid), 1e-2)
    volume_cm3 = 1e6 * topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum()
    assert volume_cm3 == pytest.approx(np.count_nonzero(solid), rel=1e-7)
    assert wrong_voxels(make_surface(mesh, 30.0), solid) == 0


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_heap_of_voxels_is_one_solid_without_walls(seed: int) -> None:
    solid = voxels(seed, 8, 0.5)
    box = trimesh.creation.box([1.0] * 3)
    at = np.argwhere(solid)
    vertices = (at[:, None] + box.vertices).reshape(-1, 3)
    faces = (8 * np.arange(len(at))[:, None, None] + box.faces).reshape(-1, 3)
    mesh = make_mesh(vertices, faces, 1e-2)
    volume_cm3 = 1e6 * topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum()
    assert volume_cm3 == pytest.approx(np.count_nonzero(solid), rel=1e-7)
    assert wrong_voxels(make_surface(mesh, 30.0), solid, -0.5) == 0


def test_edges_without_length_are_no_warning() -> None:
    """Sewing may leave two vertices in one place: what lies round their edge has no angle."""
    points = np.array([(0, 0, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], float)
    fans = [(0, 1, 2), (1, 0, 3), (0, 1, 4), (1, 0, 5)]
    with np.errstate(all="raise"):
        topology.shells(points, np.array(fans, np.int32))
