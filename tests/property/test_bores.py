"""Round tools in round openings: sides of a bore and of what goes round its mouth face each other across the hole."""

from __future__ import annotations

import manifold3d
import numpy as np
import numpy.typing as npt
import property_scenes
import pytest
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World
from property_scenes import box
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]
STEP_MM, STEPS = 5e-3, 60


def cone(low: float, high: float, low_mm: float, high_mm: float) -> property_scenes.Solid:
    """Upright, with these radii, 64 sides."""
    return manifold3d.Manifold.cylinder(
        high - low, low_mm, high_mm, circular_segments=64
    ).translate((0, 0, low))


def unit(rng: np.random.Generator) -> F64:
    """A direction, none preferred."""
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)


def slide(world: World, start_mm: F64, turn: Rotation, way: F64) -> F64:
    """Force over stiffness (n, 3) along a straight way, each pose without a past."""
    x, y, z, w = turn.as_quat()
    found = []
    for step in range(STEPS + 1):
        world.reset()
        place = 1e-3 * (start_mm + STEP_MM * step * way)
        force = world.tick([*place, w, x, y, z]).force_world_N
        found.append([force.x, force.y, force.z])
    return np.array(found)


def kicks_mm(scene: Scene, low_mm: F64, high_mm: F64, tilt_deg: float, count: int) -> F64:
    """By how much each step of random slides changes the force more than three times as far as the tool goes."""
    rng = np.random.default_rng(property_scenes.SEED)
    world = World(scene, ReplayOptions(stiffness_N_m=1000.0, force_max_N=1e6))
    found = []
    for _ in range(count):
        turn = Rotation.from_rotvec(np.radians(rng.uniform(0.0, tilt_deg)) * unit(rng))
        push = slide(world, rng.uniform(low_mm, high_mm), turn, unit(rng))
        change = np.linalg.norm(np.diff(push, axis=0), axis=1)
        found.append(np.maximum(0.0, change - 3.0 * STEP_MM))
    return np.concatenate(found)


@pytest.mark.slow
def test_a_peg_in_a_chamfered_hole_is_not_kicked() -> None:
    """Play 0.4 mm, up to 5 degrees askew. As the crease between bore and chamfer is convex, each side of the bore and
    all sides of the chamfer had one way out: 0.03 mm deep, the peg was pushed 0.6 mm across the hole."""
    plate = box((-25, 25), (-25, 25), (-20, 0)) - cone(-21, 1, 10.2, 10.2)
    hole = plate - cone(-1.0, 0.001, 10.2, 11.2)
    scene = property_scenes.bake(hole, cone(0.0, 30.0, 10.0, 10.0), 1.0, 1.0)
    kicks = kicks_mm(scene, np.array([-0.8, -0.8, -12.0]), np.array([0.8, 0.8, 0.5]), 5.0, 200)
    assert kicks.max() < 0.2
    assert kicks.sum() < 2.0
