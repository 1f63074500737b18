"""What a contact force must satisfy, held by the response way_out: judged by booleans, without a reference force.

The scenes and bounds are those of `crease bench properties`; the scenes here are the ones whose properties it keeps.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import numpy.typing as npt
import property_scenes
import pytest
from crease.replay.replay import ReplayOptions, World, run_path
from crease.replay.trajectory import Trajectory, load_trajectory
from study.properties.scenes import PropertyScene, bake_digest, image_of, load_meshes, load_scenes

ROOT = Path(__file__).resolve().parent.parent.parent
MESHES = ROOT / "build" / "meshes"
IMAGES = ROOT / "build" / "scenes" / "by_content"
SCENES = load_scenes(ROOT / "meshes" / "property_scenes.toml")
STIFFNESS_N_M = 1000.0
Rows = npt.NDArray[Any]


def answers(scene: PropertyScene) -> tuple[Rows, Trajectory]:
    """The replay of a scene's path, and the path."""
    image = image_of(scene, load_meshes(scene, MESHES), IMAGES, bake_digest())
    path = load_trajectory(MESHES / scene.path)
    options = ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="way_out", force_max_N=1e6)
    return run_path(image, path, options), path


def push_mm(scene: PropertyScene) -> tuple[np.ndarray, np.ndarray]:
    """Force over stiffness along the path of a scene, (n, 3), and the path's positions, mm."""
    rows, path = answers(scene)
    return rows["force_N"].astype(np.float64) / STIFFNESS_N_M * 1e3, 1e3 * path.position_m


def test_block_over_an_edge_feels_its_depth_and_no_more() -> None:
    for name, depth, most in (("over_edge_1", 1.0, 1.42), ("over_edge_10", 10.0, 14.2)):
        push, place = push_mm(SCENES[name])
        size = np.linalg.norm(push, axis=1)
        lying = (place[:, 0] < 0.0) & (np.abs(place[:, 2] - place[:, 2].min()) < 1e-6)
        assert lying.sum() > 50
        np.testing.assert_allclose(size[lying], depth, rtol=0.01)
        assert (
            size.max() < most
        )  # the way out of the corner that is left: at most sqrt(2) times the depth


def test_four_pads_push_as_one() -> None:
    one, four = (push_mm(SCENES[name])[0] for name in ("pads1", "pads4"))
    np.testing.assert_allclose(four, one, atol=1e-3)


def test_four_pads_do_not_turn_the_tool() -> None:
    """They are as deep as each other: the push of one alone would turn it by 34 mN m."""
    rows, _ = answers(SCENES["pads4"])
    assert np.linalg.norm(rows["force_N"], axis=1).max() > 1.0
    assert np.linalg.norm(rows["torque_Nm"], axis=1).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["legs_ridge_deep", "jaw", "corner", "ell_edge", "legs_step"])
def test_force_never_changes_faster_than_the_walls_allow(name: str) -> None:
    push, place = push_mm(SCENES[name])
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1)
    change = np.linalg.norm(np.diff(push, axis=0), axis=1)
    most = 2.0 if name == "jaw" else 1.0  # a jaw: both sides at once
    assert (change <= most * moved + 2e-3).all()


@pytest.mark.slow
def test_a_cube_pressed_deep_into_a_thick_wall_feels_its_depth() -> None:
    """Its lower samples are so far inside that the image knows no surface near them."""
    wall = property_scenes.box((-50, 50), (-50, 50), (-50, 0))
    scene = property_scenes.bake(wall, property_scenes.cube(20.0), 2.0, 2.0)
    depth_mm = np.linspace(0.0, 19.0, 96)
    place = np.column_stack([0 * depth_mm + 3.0, 0 * depth_mm + 2.0, 10.0 - depth_mm]) * 1e-3
    poses = np.hstack([place, np.tile([1.0, 0.0, 0.0, 0.0], (len(place), 1))])
    options = ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="way_out", force_max_N=1e6)
    push = property_scenes.run(scene, poses, options)["force_N"].astype(np.float64)
    np.testing.assert_allclose(push[:, 2], depth_mm, atol=0.01)
    np.testing.assert_allclose(push[:, :2], 0.0, atol=1e-3)


@pytest.mark.slow
def test_a_swallowed_cube_is_let_go_by_and_by() -> None:
    """Sample by sample it passes to where the image knows no surface: at once it would jump by 8 mm."""
    wall = property_scenes.box((-50, 50), (-50, 50), (-80, 0))
    scene = property_scenes.bake(wall, property_scenes.cube(20.0), 1.5, 1.5)
    height_mm = np.linspace(-22.0, -35.0, 1301)
    turn = np.array([0.92, 0.3, 0.2, 0.14]) / np.linalg.norm([0.92, 0.3, 0.2, 0.14])
    place = np.column_stack([0 * height_mm + 3.0, 0 * height_mm, height_mm]) * 1e-3
    poses = np.hstack([place, np.tile(turn, (len(place), 1))])
    options = ReplayOptions(
        stiffness_N_m=STIFFNESS_N_M, response="way_out", force_max_N=1e6, lookups_max=1 << 20
    )
    push = property_scenes.run(scene, poses, options)["force_N"].astype(np.float64)
    assert np.linalg.norm(push[0]) > 30.0
    assert np.linalg.norm(push[-1]) < 1.0
    assert np.linalg.norm(np.diff(push, axis=0), axis=1).max() < 0.5


@pytest.mark.slow
def test_a_corner_that_comes_down_on_a_sharp_edge_is_felt_by_and_by() -> None:
    """In a dozen attitudes, at steps of a micrometre: a coverage that ends at once would jump by 0.17 mm."""
    half_mm = 30.0 * np.tan(np.radians(12.5))
    section = manifold3d.CrossSection([[(0.0, 0.0), (-half_mm, -30.0), (half_mm, -30.0)]])
    wedge = manifold3d.Manifold.extrude(section, 80.0).translate((0, 0, -40)).rotate((90, 0, 0))
    scene = property_scenes.bake(wedge, property_scenes.cube(20.0), 1.0, 1.5)
    options = ReplayOptions(
        stiffness_N_m=STIFFNESS_N_M, response="way_out", force_max_N=1e6, lookups_max=1 << 20
    )
    rng = np.random.default_rng(3)
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) * 0.02 - 0.01
    for turn in property_scenes.random_rotations(rng, 12):
        turned = corners @ property_scenes.matrices(turn[None])[0].T
        lowest = turned[np.argmin(turned[:, 2])]
        start = np.array([rng.uniform(-0.8e-3, 0.8e-3), 0.0, 0.2e-3]) - lowest * (0.9, 0.9, 1.0)
        place = start - np.outer(np.linspace(0.0, 1.4e-3, 1401), (0.0, 0.0, 1.0))
        poses = np.hstack([place, np.tile(turn, (len(place), 1))])
        push = property_scenes.run(scene, poses, options)["force_N"].astype(np.float64)
        assert np.linalg.norm(np.diff(push, axis=0), axis=1).max() < 0.03


def test_a_ball_that_swallows_a_stump_is_led_over_its_top() -> None:
    """Its sides, most of what is touched, push against each other. Upwards by what the ball is below the top, whatever
    samples lie nearest to that; it was up to twice as much, and jumped by 56 times the motion."""
    push, place = push_mm(SCENES["ball_stump"])
    low = 15.0 - place[:, 2]
    deep = low > 1.0
    assert deep.sum() > 300
    np.testing.assert_allclose(push[deep, 2], low[deep], rtol=1e-3)
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1)
    assert (np.linalg.norm(np.diff(push, axis=0), axis=1) <= 1.4 * moved + 1e-4).all()


def dovetail(low: float, high: float, half: float, along: float) -> Any:
    """A prism along y, mm: as wide as 2 half at z = 0, and wider below by flanks of 60 degrees."""
    outline = [
        (side * (half - z / np.sqrt(3.0)), z)
        for side, z in ((-1, low), (1, low), (1, high), (-1, high))
    ]
    prism = manifold3d.CrossSection([outline]).extrude(2 * along)
    return prism.rotate((90, 0, 0)).translate((0, along, 0))


@pytest.mark.parametrize(("low", "high", "spacing_mm"), [(-7.6, 0.0, 1.0), (-6.0, -2.0, 2.0)])
def test_a_slanted_crease_is_as_deep_as_it_is(low: float, high: float, spacing_mm: float) -> None:
    """A slider against one flank of its bed. Its creases lie level with the flank, and along no axis: which way
    they go was rounding, and they were up to half a sample too deep, by turns."""
    bed = property_scenes.box((-25, 25), (-25, 25), (-18, 0)) - dovetail(-8.0, 1.0, 6.0, 26.0)
    scene = property_scenes.bake(bed, dovetail(low, high, 5.7, 12.0), 1.0, spacing_mm)
    world = World(scene, ReplayOptions(stiffness_N_m=STIFFNESS_N_M))
    for shift in np.linspace(0.4, 1.4, 41):
        world.reset()
        force = world.tick([1e-3 * shift, -2.6e-5, 0.0, 1.0, 0.0, 0.0, 0.0]).force_world_N
        push_mm = 1e3 / STIFFNESS_N_M * np.linalg.norm([force.x, force.y, force.z])
        assert push_mm == pytest.approx((shift - 0.3) * np.sin(np.pi / 3), abs=2e-3)


def test_walls_of_a_corner_answer_each_for_itself() -> None:
    push, place = push_mm(SCENES["corner"])
    inside = np.maximum(0.0, 10.0 - place)  # a cube of 20 mm in the corner at the origin
    np.testing.assert_allclose(push, inside, atol=0.02)
