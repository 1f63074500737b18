"""A ball over the round rim of a turned part, many facets at once: what the facets' cut and order may not do."""

from __future__ import annotations

import manifold3d as mf
import numpy as np
import numpy.typing as npt
import pytest
import shapes
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.scene import open_image
from crease.mesh.mesh import make_mesh
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory

RIM_MM, TOP_MM, BALL_MM, DEEP_MM = 30.0, 20.0, 8.0, 1.5
STEP_MM = 0.01


def over_the_rim(azimuth_rad: float) -> npt.NDArray[np.float64]:
    """Centres, mm, round a point of the rim from above it to beside it, and the normals there, (2, n, 3)."""
    count = int((BALL_MM - DEEP_MM) * np.pi / 2 / STEP_MM)
    turn = np.linspace(0.05, np.pi / 2 - 0.05, count)[:, None]
    outward = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
    normal = np.sin(turn) * outward + np.cos(turn) * np.array([0.0, 0.0, 1.0])
    rim = RIM_MM * outward + np.array([0.0, 0.0, TOP_MM])
    return np.stack([rim + (BALL_MM - DEEP_MM) * normal, normal])


@pytest.mark.slow
@pytest.mark.parametrize("sides", [24, 96])
def test_a_round_rim_neither_kicks_nor_pushes_aside(sides: int) -> None:
    turned = mf.Manifold.cylinder(2 * TOP_MM, RIM_MM, RIM_MM, sides, True)
    part = make_mesh(*shapes.from_manifold(turned), 1e-3)
    ball = make_mesh(*shapes.ball(BALL_MM, 4), 1e-3)
    scene = open_image(bake_scene(part, ball, BakeOptions()).image, "rim")
    for azimuth_rad in (0.7, 0.7 + np.pi / sides, 2.2):
        centre_mm, normal = over_the_rim(azimuth_rad)
        rows = np.zeros((len(centre_mm), 8))
        rows[:, 0] = 1e-3 * np.arange(len(rows))
        rows[:, 1:4], rows[:, 4] = 1e-3 * centre_mm, 1.0
        options = ReplayOptions()
        way_mm = (
            1e3
            / options.stiffness_N_m
            * run_path(scene, Trajectory(rows, "made here"), options)["force_N"]
        )
        jump = np.linalg.norm(np.diff(way_mm, axis=0), axis=1)
        cosine = (way_mm * normal).sum(axis=1) / np.linalg.norm(way_mm, axis=1)
        assert jump.max() < 2.5 * STEP_MM
        assert (
            np.degrees(np.arccos(cosine)).max() < 9.0
        )  # a face is felt until its neighbour takes over
        assert np.linalg.norm(way_mm - DEEP_MM * normal, axis=1).max() < 0.3
