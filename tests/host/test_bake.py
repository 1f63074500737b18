"""Bakes whose sizes are out of the ordinary: every path through the choice of brick resolutions."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.layout import CLUSTER, FACET
from crease.bake.shell import make_shell
from crease.bake.surface import make_surface
from crease.base.errors import MeshError
from crease.base.native import ffi
from crease.base.scene import open_image
from crease.mesh.mesh import Mesh, make_mesh


@pytest.mark.parametrize("tolerance_m", [1e-6, 1e-4, 1e-2])
def test_a_ball_bakes_at_any_tolerance(tolerance_m: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    tool = trimesh.creation.box(extents=(10.0, 10.0, 10.0))
    static = make_mesh(ball.vertices, ball.faces, 1e-3, source="ball", digest_sha256="0" * 64)
    cube = make_mesh(tool.vertices, tool.faces, 1e-3, source="cube", digest_sha256="0" * 64)
    options = BakeOptions(voxel_m=4e-3, spacing_m=2e-3, tolerance_m=tolerance_m)
    result = bake_scene(static, cube, options)
    scene = open_image(result.image, "ball")
    assert 0.0 < scene.meta.error_max_m < max(1.5 * tolerance_m, 0.5e-3)


def test_what_rounding_left_of_zeros_is_not_in_the_image() -> None:
    # Boxes that stand askew: of a normal, an area vector and a second moment, what is none comes out as 1e-17 of the
    # rest, and the products that the tick makes of those as denormal numbers: bar_u took 1.6 times as long.
    block = trimesh.creation.box(extents=(20.0, 20.0, 20.0))
    block.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (0.0, 0.0, 1.0)))
    tool = make_mesh(block.vertices, block.faces, 1e-3, source="block", digest_sha256="0" * 64)
    options = BakeOptions(voxel_m=4e-3, spacing_m=2e-3)
    scene = open_image(bake_scene(tool, tool, options).image, "blocks")
    counts = (
        (scene.handle.clusters, CLUSTER, scene.handle.cluster_count),
        (scene.handle.facets, FACET, 6),
    )
    clusters, facets = (
        np.frombuffer(ffi.buffer(at, count * record.itemsize), record)
        for at, record, count in counts
    )
    moments = np.stack(
        [clusters[name] for name in ("wxx", "wyy", "wzz", "wxy", "wyz", "wzx")], axis=-1
    )
    areas = np.stack([clusters[name] for name in ("ax", "ay", "az")], axis=-1)
    for values in (moments, areas, facets["normal"]):
        size, most = np.abs(values), np.abs(values).max(axis=-1, keepdims=True)
        assert np.any(size == 0.0)
        assert np.all((size == 0.0) | (size > 1e-10 * most))


@pytest.mark.slow
def test_bakes_at_the_same_time_find_the_facets_of_one_alone() -> None:
    # Many facets each, and different ones: a sort key that threads share would order one mesh by another's areas.
    balls = [trimesh.creation.icosphere(subdivisions=s, radius=20.0) for s in (5, 5, 4)]
    for number, ball in enumerate(balls):
        ball.vertices *= 1.0 + 0.2 * np.sin(np.arange(len(ball.vertices)) + number)[:, None]
    meshes = [
        make_mesh(b.vertices, b.faces, 1e-3, source="b", digest_sha256="0" * 64) for b in balls
    ]

    def facets(mesh: Mesh) -> bytes:
        surface = make_surface(mesh, 20.0)
        return surface.facet_of.tobytes() + surface.patch_of.tobytes()

    alone = [facets(mesh) for mesh in meshes]
    with ThreadPoolExecutor(max_workers=6) as threads:
        together = list(threads.map(facets, meshes * 10))
    differing = sum(found != alone[i % 3] for i, found in enumerate(together))
    assert differing == 0, f"{differing} of {len(together)} calls"


@pytest.mark.slow
def test_a_tool_with_more_detail_than_a_tick_can_work_off_is_refused() -> None:
    # Cubes of 0.1 mm in a heap as wide as one sample: every sample is beside every other.
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in (4, 4, 4))), axis=-1).reshape(-1, 3)
    cubes = [trimesh.creation.box(extents=(0.1, 0.1, 0.1)) for _ in grid]
    for cube, place in zip(cubes, grid, strict=True):
        cube.apply_translation(0.2 * place)
    heap = trimesh.util.concatenate(cubes)
    mesh = make_mesh(heap.vertices, heap.faces, 1e-3, source="heap", digest_sha256="0" * 64)
    with pytest.raises(MeshError, match="at most 512: the tool has creases much closer"):
        make_shell(make_surface(mesh, 30.0), spacing_m=2e-3)
