"""A tool through a plate touches both faces as one area: where they balance there is no way out, and no force."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from crease.replay.replay import ReplayOptions
from property_scenes import bake, box, run

HALF_MM, RADIUS_MM = 1.2, 4.0


@pytest.mark.slow
def test_force_through_a_plate_stays_within_the_overlap_and_fades_at_balance() -> None:
    """As found by `crease stress`: at balance depth was 28 m, which the force limit hid."""
    plate = box((-30, 30), (-30, 30), (-HALF_MM, HALF_MM))
    # As blunt below as above: the overlap is symmetric about the middle of the plate when the rod is.
    rod = manifold3d.Manifold.cylinder(16, RADIUS_MM, RADIUS_MM, 48, True)
    scene = bake(plate, rod, 1.0, 1.0)
    height = np.concatenate([np.linspace(-6e-3, 6e-3, 1201), [0.0], np.linspace(-2e-6, 2e-6, 401)])
    tilt = np.radians(4.0)
    poses = np.zeros((len(height), 7))
    poses[:, 2], poses[:, 3], poses[:, 4] = height, np.cos(tilt / 2), np.sin(tilt / 2)
    rows = run(scene, poses, ReplayOptions(force_max_N=1e6))
    assert (rows["areas"] > 0).any()
    assert np.isfinite(rows["force_N"]).all()
    assert rows["depth_m"].max() < 2 * float(scene.meta.tool_radius_m)
