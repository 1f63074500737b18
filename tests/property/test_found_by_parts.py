"""A ball over machine parts whose teeth are about as thick as its samples are apart: no kick within a tick of 0.05 mm.

Found on strokes over their ridges and pockets (`make bench-meshes-force`)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import parts
import pytest
from crease.bake.bake import bake_scene
from crease.base.scene import Scene, open_image
from crease.mesh.mesh import load_mesh, make_mesh
from crease.replay.replay import ReplayOptions
from study.properties.answers import asker

MESHES = Path(__file__).resolve().parents[2] / "build" / "meshes"
AMPLIFICATION_MAX = 1.1

FOUND = [
    # before, mm, and quaternion; after, mm
    (
        [16.580765, 19.760183, -12.525449, -0.355666, 0.778934, 0.192238, 0.479383],
        [16.593659, 19.77555, -12.47973],
    ),
    (
        [16.624963, 19.812856, -12.477775, -0.355666, 0.778934, 0.192238, 0.479383],
        [16.657054, 19.851101, -12.477691],
    ),
    (
        [16.567872, 19.744817, -12.571167, -0.355666, 0.778934, 0.192238, 0.479383],
        [16.580765, 19.760183, -12.525449],
    ),
    (
        [16.543363, 23.300465, 21.2828, 0.943553, -0.041798, -0.300152, 0.133675],
        [16.580194, 23.3055, 21.316171],
    ),
    (
        [80.051564, 24.897099, 19.772442, -0.355821, 0.217052, 0.062208, 0.906868],
        [80.030694, 24.881235, 19.801907],
    ),
]


@cache
def gears() -> Scene:
    static = parts.PARTS["gear_pair"]()
    mesh = make_mesh(static.vertices * 1e-3, static.faces, 1.0, source="gear_pair")
    return open_image(bake_scene(mesh, load_mesh(MESHES / "ball15.stl", 1e-3)).image, "gear_pair")


@pytest.mark.slow
@pytest.mark.parametrize("which", range(len(FOUND)))
def test_a_sample_amid_a_tooth_passes_from_flank_to_flank(which: int) -> None:
    before, after = FOUND[which]
    poses = np.array([before, [*after, *before[3:]]])
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
    way_mm = asker(gears(), ReplayOptions())(poses).way_mm
    assert np.linalg.norm(way_mm[0]) > 0.3
    motion = np.linalg.norm(poses[1, :3] - poses[0, :3])
    assert np.linalg.norm(way_mm[1] - way_mm[0]) < AMPLIFICATION_MAX * motion
