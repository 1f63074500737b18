"""Exact signed distances (host/native/surface) against libigl, which shares no code with them."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from crease.bake.surface import flatten, join_narrow, make_surface
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


def knurled(teeth: int) -> trimesh.Trimesh:
    """A block of 20 mm; amid its top teeth x teeth pyramids of 1 mm and 45 degrees, into each other."""
    at = np.arange(0.5 * (1 - teeth), 0.5 * teeth)
    low, high = [-10.0, -10.0, -9.0], [10.0, 10.0, 0.0]
    shape = trimesh.creation.box(bounds=[low, high])
    tooth = trimesh.creation.cone(1.02 * np.sqrt(0.5), 0.51, sections=4)
    tooth.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, [0, 0, 1]))
    teeth_at = [tooth.copy().apply_translation([x, y, 0.0]) for x in at for y in at]
    return trimesh.boolean.union([shape, *teeth_at], engine="manifold")


def test_patches_between_samples_are_one() -> None:
    shape = knurled(6)
    told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="knurled"), 30.0)
    # The outer sides of the outer ones go on from each to the next.
    assert told.counts["patches"] == 6 + 4 + 4 * 36 - 4 * 6
    surface = join_narrow(told, 1e-3)
    assert surface.counts["patches"] == 6 + 1
    sizes = np.bincount(surface.patch_of, told.facet_area_m2[told.facet_of] > 0.0)
    assert sizes.max() >= 4 * 36
    kept = told.creases.ends_m[:, :, 2].max(axis=1) < 1e-9  # of the block, and round all pyramids
    np.testing.assert_array_equal(surface.creases.ends_m, told.creases.ends_m[kept])
    assert (surface.creases.patch[:, 0] != surface.creases.patch[:, 1]).all()
    assert (
        surface.counts["convex_edges"] == surface.creases.convex.sum() < told.creases.convex.sum()
    )
    edges = ("smooth_edges", "convex_edges", "concave_edges")
    assert sum(surface.counts[e] for e in edges) == sum(told.counts[e] for e in edges)


def test_patches_of_narrow_facets_are_fine() -> None:
    """A drum of 24 sides, 5.2 mm wide and 10 mm high: twice the area by the border is 3.4 mm."""
    shape = trimesh.creation.cylinder(20.0, 10.0, sections=24)
    told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="drum"), 30.0)
    assert not told.fine.any()
    side = told.facet_patch[np.abs(told.facet_plane[:, 2]) < 0.5]
    assert len(np.unique(side)) == 1
    assert np.flatnonzero(join_narrow(told, 1.8e-3).fine).tolist() == [side[0]]
    assert not join_narrow(told, 1.6e-3).fine.any()


def chamfered(side: float, chamfer: float) -> trimesh.Trimesh:
    """A cube whose edges are cut off."""
    half = 0.5 * side
    corners = half - chamfer * (1.0 - np.eye(3))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    return trimesh.convex.convex_hull((signs[:, None] * corners).reshape(-1, 3))


def test_chamfers_and_wide_patches_stay_what_they_are() -> None:
    shape = chamfered(20.0, 0.5)
    told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="chamfered"), 30.0)
    assert told.counts["patches"] == 6 + 12 + 8
    pyramids = knurled(6)
    fine = make_surface(make_mesh(pyramids.vertices, pyramids.faces, 1e-3, source="knurled"), 30.0)
    for before, after in ((told, join_narrow(told, 1e-3)), (fine, join_narrow(fine, 1e-4))):
        assert after.counts == before.counts
        np.testing.assert_array_equal(after.patch_of, before.patch_of)
        np.testing.assert_array_equal(after.creases.patch, before.creases.patch)


def rough(amplitude: float) -> trimesh.Trimesh:
    """A block of 20 mm whose corners are off by up to an amplitude in mm, each way; a groove of 16 sides on top."""
    groove = trimesh.creation.cylinder(4.0, 30.0, sections=48)
    groove.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    groove.apply_translation([0.0, 0.0, 12.0])
    shape = trimesh.boolean.difference(
        [trimesh.creation.box([20.0] * 3), groove], engine="manifold"
    ).subdivide_to_size(6.0)
    rng = np.random.default_rng(8)
    shape.vertices = shape.vertices + amplitude * rng.uniform(-1.0, 1.0, shape.vertices.shape)
    return shape


def test_rough_flat_faces_are_one_facet_each() -> None:
    shape = rough(0.005)
    told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="rough"), 30.0)
    assert told.counts["patches"] == 8
    assert told.counts["facets"] > 500
    within_m = 0.01e-3
    surface = flatten(told, within_m)
    of_patch = np.bincount(surface.facet_patch)
    groove = int(np.argmax(of_patch))
    assert of_patch[groove] == np.count_nonzero(told.facet_patch == groove) > 50
    assert surface.counts["facets"] == len(surface.facet_patch) == of_patch[groove] + 7
    assert surface.facet_area_m2.sum() == pytest.approx(told.facet_area_m2.sum())
    np.testing.assert_array_equal(surface.facet_patch[surface.facet_of], surface.patch_of)
    corners = surface.mesh.vertices_m[surface.mesh.triangles]
    plane = surface.facet_plane[surface.facet_of]
    flat = surface.patch_of != groove
    off_m = np.einsum("nkx,nx->nk", corners, plane[:, :3]) - plane[:, 3:]
    assert 0.004e-3 < np.abs(off_m[flat]).max() < within_m
    exact = np.abs(np.abs(plane[flat, :3]).max(axis=1) - 1.0)
    assert exact.max() < 1e-5  # 0.26 degrees, where triangles are off by up to one


def test_what_is_no_flatter_than_that_keeps_its_facets() -> None:
    """A cap 0.2 mm high on a disk of 20 mm, a lens with a pin, a block, whose faces are facets already, and a
    chamfer of 0.1 mm round a disc, which is off a plane by half of that."""
    cap = trimesh.creation.icosphere(4, radius=250.0)
    cap = trimesh.intersections.slice_mesh_plane(cap, [0, 0, 1], [0, 0, 249.8], cap=True)
    lens = trimesh.creation.icosphere(5, radius=10.0)
    lens.apply_scale([1.0, 1.0, 0.1])
    pin = trimesh.creation.cylinder(1.0, 3.0, sections=24)
    pin.apply_translation([0.0, 0.0, 2.0])
    lens = trimesh.boolean.union([lens, pin], engine="manifold")
    block = trimesh.creation.box([20.0] * 3)
    disc = trimesh.creation.cylinder(20.0, 3.0, sections=64)
    cut = trimesh.creation.cone(21.4, 21.4, sections=64)
    cut.apply_translation([0.0, 0.0, -20.0])
    bevelled = trimesh.boolean.intersection([disc, cut], engine="manifold")
    for shape, angle, within_m in (
        (cap, 30.0, 5e-5),
        (lens, 60.0, 2e-3),
        (block, 30.0, 5e-5),
        (bevelled, 30.0, 1e-4),
    ):
        told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="cap"), angle)
        assert flatten(told, within_m) is told


def test_isles_narrower_than_samples_are_part_of_what_they_lie_in() -> None:
    """A ball of 20,480 triangles of 1 mm, rough by 0.15 of that, as scans are: single triangles stand out from it."""
    ball = trimesh.creation.icosphere(5, radius=30.0)
    rough_mm = 0.15 * ball.edges_unique_length.mean()
    rng = np.random.default_rng(3)
    vertices = ball.vertices + rough_mm * rng.standard_normal(ball.vertices.shape)
    told = make_surface(make_mesh(vertices, ball.faces, 1e-3, source="rough ball"), 30.0)
    assert told.counts["patches"] > 300
    surface = join_narrow(told, 2e-3)
    assert surface.counts["patches"] < 0.2 * told.counts["patches"]
    area_m2 = np.bincount(surface.facet_patch, surface.facet_area_m2)
    assert area_m2.max() > 0.99 * area_m2.sum()


def bored(outer: float, radius: float, depth: float, bevel: float) -> trimesh.Trimesh:
    """A disc 10 mm high with a bore in its top that is bevelled at 45 degrees."""
    disc = trimesh.creation.cylinder(outer, 10.0, sections=64)
    bore = trimesh.creation.cylinder(radius, 2.0 * depth, sections=32)
    cone = trimesh.creation.cone(radius + bevel, radius + bevel, sections=32)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    away = [bore, cone] if bevel else [bore]
    for shape in away:
        shape.apply_translation([0.0, 0.0, 5.0])
    return trimesh.boolean.difference([disc, *away], engine="manifold")


@pytest.mark.parametrize(
    ("shape", "patches"),
    [
        (bored(10.0, 1.0, 10.0, 0.3), 5),
        (bored(10.0, 1.0, 10.0, 0.9), 5),
        (bored(10.0, 0.5, 3.0, 0.0), 5),
        (bored(10.0, 1.0, 3.0, 0.0), 5),
        (trimesh.creation.cylinder(0.5, 20.0, sections=32), 3),
    ],
)
def test_ends_of_pins_and_bores_and_bevels_are_no_isles(
    shape: trimesh.Trimesh, patches: int
) -> None:
    """They face another way than what is round them, or have two things round them."""
    told = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3, source="bored"), 30.0)
    assert told.counts["patches"] == patches
    surface = join_narrow(told, 1.2e-3)
    assert surface.counts["patches"] == patches
    assert len(surface.creases.convex) == len(told.creases.convex)
