"""Low steps in a floor, found by pressing blocks on them: a flat block is as deep as in what it is deepest in."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import property_scenes
import pytest
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World
from property_scenes import box

F64 = npt.NDArray[np.float64]
STIFFNESS_N_M = 1000.0


def pushes_mm(scene: Scene, places_mm: F64) -> F64:
    """Force over stiffness at each place, (n, 3), each without a past."""
    world = World(scene, ReplayOptions(stiffness_N_m=STIFFNESS_N_M))
    found = []
    for place in places_mm:
        world.reset()
        force = world.tick([*(1e-3 * place), 1.0, 0.0, 0.0, 0.0]).force_world_N
        found.append([force.x, force.y, force.z])
    return 1e3 / STIFFNESS_N_M * np.array(found)


@pytest.mark.parametrize("voxel_mm", [1.0, 0.5])
@pytest.mark.parametrize("step_mm", [0.1, 0.2, 0.3, 0.5])
def test_a_block_over_a_low_step_is_as_deep_as_in_the_higher_floor(
    step_mm: float, voxel_mm: float
) -> None:
    """Lying flat, while over half of it lies there. Two faces of a step are one way out in part, and it was up to 22 %
    short: what counts for both half-spaces in part counted for neither in full."""
    floor = box((-30, 0), (-25, 25), (-15, 0)) + box((-1, 30), (-25, 25), (-15, -step_mm))
    scene = property_scenes.bake(floor, box((-9, 9), (-6, 6), (-4, 4)), voxel_mm, 1.0)
    shift = np.linspace(-3.0, 3.0, 601)
    push = pushes_mm(scene, np.column_stack([shift, 0 * shift, 0 * shift + 3.5]))
    assert push[:, 2].min() > 0.495
    assert push[:, 2].max() < 0.515
    assert np.abs(np.diff(push[:, 2])).max() < 0.015
