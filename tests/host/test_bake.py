"""Bakes whose sizes are out of the ordinary: every path through the choice of brick resolutions."""

from __future__ import annotations

import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.scene import open_image
from crease.mesh.mesh import make_mesh


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
