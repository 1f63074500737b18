"""Exact signed distances (host/native/surface) against libigl, which shares no code with them."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from crease.bake.surface import make_surface
from crease.mesh.mesh import load_mesh, make_mesh
from numpy.typing import NDArray

MESHES = Path(__file__).resolve().parents[2] / "build" / "meshes"
PSEUDO = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
TOLERANCE_M = 1e-15
"""Rounding of coordinates of 0.1 m."""


def near_and_far(
    vertices_m: NDArray[np.float64], triangles: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Points all over the box and beyond, close to the surface, and exactly on corners, sides and faces, (n, 3)."""
    rng = np.random.default_rng(5)
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    box = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (6000, 3))
    chosen = vertices_m[triangles[rng.integers(0, len(triangles), 2000)]]
    share = rng.dirichlet([1.0, 1.0, 1.0], 2000)
    on = np.einsum("nk,nkx->nx", share, chosen)
    beside = on + rng.normal(scale=1e-3 * float((high - low).max()), size=on.shape)
    return np.concatenate([box, on, beside, chosen[:, 0], 0.5 * (chosen[:, 0] + chosen[:, 1])])


@pytest.mark.parametrize("name", ["block45k", "featuretype", "spanner", "u_tool", "ball15"])
def test_distance_sign_and_triangle_are_those_of_libigl(name: str) -> None:
    mesh = load_mesh(MESHES / f"{name}.stl", 1e-3)
    points = near_and_far(mesh.vertices_m, mesh.triangles)
    ours, nearest = make_surface(mesh, 30.0).signed_distance(points)
    corners, faces = mesh.vertices_m, mesh.triangles.astype(np.int64)
    theirs = np.sqrt(igl.point_mesh_squared_distance(points, corners, faces)[0])
    np.testing.assert_allclose(np.abs(ours), theirs, rtol=0, atol=TOLERANCE_M)
    signed = igl.signed_distance(points, corners, faces, PSEUDO)[0]
    clear = theirs > 1e-12
    assert clear.sum() >= 8000
    assert np.array_equal(ours[clear] < 0, signed[clear] < 0)
    # Where several triangles are as near, either of them will do.
    for point, triangle, distance in zip(points[::50], nearest[::50], theirs[::50], strict=True):
        alone = igl.point_mesh_squared_distance(point[None], corners, faces[triangle][None])[0]
        assert abs(np.sqrt(np.ravel(alone)[0]) - distance) <= TOLERANCE_M


def test_distances_from_a_mesh_too_large_for_the_cache_are_those_of_libigl() -> None:
    # Flat faces and slender triangles, askew in all axes: where boxes tell least, and cylinders do.
    shape = trimesh.creation.cylinder(30.0, 80.0, sections=80)
    for _ in range(4):
        shape = shape.subdivide()
    shape.apply_transform(trimesh.transformations.euler_matrix(0.4, 0.7, 0.2))
    assert len(shape.faces) == 81_920
    mesh = make_mesh(shape.vertices, shape.faces, 1e-3, source="cylinder")
    points = near_and_far(mesh.vertices_m, mesh.triangles)
    ours, _ = make_surface(mesh, 30.0).signed_distance(points)
    corners, faces = mesh.vertices_m, mesh.triangles.astype(np.int64)
    theirs = np.sqrt(igl.point_mesh_squared_distance(points, corners, faces)[0])
    np.testing.assert_allclose(np.abs(ours), theirs, rtol=0, atol=TOLERANCE_M)
