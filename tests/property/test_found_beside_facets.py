"""Planes of facets where the facets are not: found by pressing parts of machines against each other.

A plane goes on for ever, its facet does not. What is nearest, and what is left through, is told by where facets lie.
Poses are straight, seeded, and free but for the one face that is pressed; what a right answer is follows from that.
"""

from __future__ import annotations

from typing import Any

import crease
import manifold3d
import numpy as np
import numpy.typing as npt
import property_scenes
import pytest
from crease.base.scene import Scene
from crease.mesh.mesh import make_mesh
from crease.replay.replay import ReplayOptions, World
from property_scenes import box, surface_of

F64 = npt.NDArray[np.float64]
STIFFNESS_N_M = 1000.0


def prism(sides: int, inner_mm: float, low: float, high: float) -> Any:
    """Upright, inner_mm from its axis to the middle of a side."""
    outer = inner_mm / np.cos(np.pi / sides)
    return manifold3d.Manifold.cylinder(
        high - low, outer, outer, circular_segments=sides
    ).translate((0, 0, low))


def pushes_mm(scene: Scene, places_mm: F64) -> F64:
    """Force over stiffness at each place, (n, 3), each without a past."""
    world = World(scene, ReplayOptions(stiffness_N_m=STIFFNESS_N_M))
    found = []
    for place in places_mm:
        world.reset()
        force = world.tick([*(1e-3 * place), 1.0, 0.0, 0.0, 0.0]).force_world_N
        found.append([force.x, force.y, force.z])
    return 1e3 / STIFFNESS_N_M * np.array(found)


@pytest.mark.parametrize(
    ("sides", "inner_mm", "clearance_mm", "sideways_mm"),
    [
        (6, 6.5, 0.3, 0.06),
        (6, 6.5, 0.6, 1e-3),
        (4, 6.5, 0.3, 1e-3),
        (64, 7.0, 0.3, 0.18),
        (64, 7.0, 0.6, 3e-3),
    ],
)
def test_a_boss_that_is_not_touched_does_not_push(
    sides: int, inner_mm: float, clearance_mm: float, sideways_mm: float
) -> None:
    """A plate with a hole round it is pressed into the floor. Below the floor the planes of the boss go on: a hexagon
    pushed aside by 2.4 mm."""
    floor = box((-30, 30), (-30, 30), (-12, 0)) + prism(sides, inner_mm, -1.0, 8.0)
    hole = prism(sides, inner_mm + clearance_mm, -1.0, 10.0)
    scene = property_scenes.bake(floor, box((-12, 12), (-12, 12), (0, 5)) - hole, 1.0, 1.0)
    rng = np.random.default_rng(property_scenes.SEED)
    places = rng.uniform((-0.4, -0.4, -1.0), (0.4, 0.4, -0.1), (150, 3))
    places[:, :2] *= clearance_mm
    push = pushes_mm(scene, places)
    np.testing.assert_allclose(push[:, 2], -places[:, 2], atol=1e-3)
    assert np.linalg.norm(push[:, :2], axis=1).max() < sideways_mm


@pytest.mark.slow
def test_a_pin_across_a_bore_is_held_by_both_its_rims() -> None:
    """The planes of the bore's walls go on over the plate, where nothing ends: by them a pin 1.8 mm deep was 0.3."""
    bore = manifold3d.Manifold.cylinder(20, 6, 6, circular_segments=48, center=True)
    plate = box((-25, 25), (-25, 25), (-10, 0)) - bore
    turn = np.arange(48) * 2 * np.pi / 48
    ends = [(x, 3 * np.cos(a), 3 * np.sin(a)) for x in (-12.5, 12.5) for a in turn]
    pin = manifold3d.Manifold.hull_points(np.array(ends))
    scene = crease.bake(*(make_mesh(*surface_of(solid), 1e-3) for solid in (plate, pin)))
    world = crease.World(scene, stiffness=STIFFNESS_N_M, force_max=1e6)
    rng, clear = np.random.default_rng(5), 0
    for _ in range(800):
        yaw, angle, deep_mm = rng.uniform((0.0, 0.0, 0.3), (2 * np.pi, 2 * np.pi, 2.0))
        off_mm = 9 * np.sqrt(rng.uniform()) * np.array([np.cos(angle), np.sin(angle)])
        place_mm = [*off_mm, 3 - deep_mm]
        world.reset()
        out = world.tick([*(1e-3 * np.array(place_mm)), np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        if out.record["stats"]["zones_dropped"][0] == 0:
            clear += 1
            pushed_mm = 1e3 / STIFFNESS_N_M * out.force_N
            assert pushed_mm[2] == pytest.approx(deep_mm, rel=0.1), (place_mm, yaw, pushed_mm)
            assert np.abs(pushed_mm[:2]).max() < 0.05 * deep_mm, (place_mm, yaw, pushed_mm)
    assert clear > 700


@pytest.mark.slow
@pytest.mark.parametrize("voxel_mm", [1.0, 0.5])
@pytest.mark.parametrize("step_mm", [0.1, 0.2, 0.3, 0.5])
def test_a_block_over_a_low_step_is_as_deep_as_in_the_higher_floor(
    step_mm: float, voxel_mm: float
) -> None:
    """Lying flat, while over half of it lies there. It was up to 22 % short."""
    floor = box((-30, 0), (-25, 25), (-15, 0)) + box((-1, 30), (-25, 25), (-15, -step_mm))
    scene = property_scenes.bake(floor, box((-9, 9), (-6, 6), (-4, 4)), voxel_mm, 1.0)
    shift = np.linspace(-3.0, 3.0, 601)
    push = pushes_mm(scene, np.column_stack([shift, 0 * shift, 0 * shift + 3.5]))
    assert push[:, 2].min() > 0.495
    assert push[:, 2].max() < 0.515
    assert np.abs(np.diff(push[:, 2])).max() < 0.015


def test_a_wall_against_the_rim_of_an_eye_is_as_deep_as_it_is() -> None:
    """From 1 mm on its samples lie over the side faces or the bore. The facets of the rim that are known then are left
    through where they are, not before it: the wall was up to 1.4 mm too deep."""
    eye, bore = (
        manifold3d.Manifold.cylinder(wide, r, circular_segments=64).translate((0, 0, -wide / 2))
        for wide, r in ((6, 8), (8, 4))
    )
    bar = box((-20, 0), (-3, 3), (-8, 8)) + eye.rotate((90, 0, 0)) - bore.rotate((90, 0, 0))
    scene = property_scenes.bake(bar, box((9.5, 14), (-8, 8), (-7, 7)), 1.0, 1.0)
    rng = np.random.default_rng(property_scenes.SEED)
    deep, across, along = rng.uniform((0.2, -0.2, -3.0), (2.0, 0.2, 3.0), (600, 3)).T
    push = pushes_mm(scene, np.column_stack([8.0 - 9.5 - deep, across, along]))
    off = np.abs(np.linalg.norm(push, axis=1) - deep)
    assert off.max() < 0.16
    assert np.mean(off > 0.05) < 0.05
