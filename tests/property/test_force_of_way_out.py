"""What a contact force must satisfy, held by the response way_out: judged by booleans, without a reference force.

The scenes and bounds are those of `crease bench properties`; the scenes here are the ones whose properties it keeps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import load_trajectory
from study.properties.scenes import PropertyScene, bake_digest, image_of, load_meshes, load_scenes

ROOT = Path(__file__).resolve().parent.parent.parent
MESHES = ROOT / "build" / "meshes"
IMAGES = ROOT / "build" / "scenes" / "by_content"
SCENES = load_scenes(ROOT / "meshes" / "property_scenes.toml")
STIFFNESS_N_M = 1000.0


def push_mm(scene: PropertyScene) -> tuple[np.ndarray, np.ndarray]:
    """Force over stiffness along the path of a scene, (n, 3), and the path's positions, mm."""
    image = image_of(scene, load_meshes(scene, MESHES), IMAGES, bake_digest())
    path = load_trajectory(MESHES / scene.path)
    options = ReplayOptions(stiffness_N_m=STIFFNESS_N_M, response="way_out", force_max_N=1e6)
    rows = run_path(image, path, options)
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


@pytest.mark.parametrize("name", ["legs_ridge_deep", "jaw", "corner"])
def test_force_never_changes_faster_than_the_walls_allow(name: str) -> None:
    push, place = push_mm(SCENES[name])
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1)
    change = np.linalg.norm(np.diff(push, axis=0), axis=1)
    most = 2.0 if name == "jaw" else 1.0  # a jaw: both sides at once
    assert (change <= most * moved + 2e-3).all()


def test_walls_of_a_corner_answer_each_for_itself() -> None:
    push, place = push_mm(SCENES["corner"])
    inside = np.maximum(0.0, 10.0 - place)  # a cube of 20 mm in the corner at the origin
    np.testing.assert_allclose(push, inside, atol=0.02)
