"""A ball along round parts that are cut coarsely: how a round surface is cut into facets may not be felt as a kick."""

from __future__ import annotations

import curved
import numpy as np
import numpy.typing as npt
import pytest
import shapes
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.voxmap import flat_facets
from crease.base.scene import open_image
from crease.replay.replay import ReplayOptions
from study.properties.answers import asker

AMPLIFICATION_MAX = 1.1

FOUND = {
    # scene of tests/bench/curved.py, index of its tessellation, path
    "facets of a round surface are planes in some cells and round in others": ("torus", 0, 7),
    "the same where it bends both ways": ("saddle", 0, 18),
    "more planes than bound a half-space, the heaviest left out": ("involute", 2, 4),
}


@pytest.mark.slow
@pytest.mark.parametrize("cause", FOUND)
def test_a_ball_on_a_coarse_round_part_is_not_kicked(cause: str) -> None:
    name, level, number = FOUND[cause]
    scene = curved.SCENES[name]
    random = np.random.default_rng(13)
    centre = [curved.path_of(scene, random) for _ in range(number + 1)][number]
    static = curved.mesh_of(scene.mesh(curved.SIDES[level]))
    tool = curved.mesh_of(shapes.ball(scene.ball_mm, 3 + level))
    baked = open_image(bake_scene(static, tool, BakeOptions()).image, name)
    poses = np.column_stack([centre, np.tile([1.0, 0.0, 0.0, 0.0], (len(centre), 1))])
    way_mm = asker(baked, ReplayOptions())(poses).way_mm
    assert np.linalg.norm(way_mm, axis=1).max() > 1.0
    assert curved.rates(way_mm, centre)[1:].max() < AMPLIFICATION_MAX


def test_facets_that_no_brick_sees_alone_are_round() -> None:
    """A facet alone in its patch stays a plane; of a patch of several those that fill a brick do."""
    patch: npt.NDArray[np.int32] = np.array([0, 1, 1, 1, 2], np.int32)
    seen = np.zeros((3, 9, 9, 9), np.int32)
    seen[0], seen[1], seen[2] = 1, 2, 4
    seen[1, 8, 8, 8] = 3
    np.testing.assert_array_equal(flat_facets(patch, seen), [True, True, False, False, True])
