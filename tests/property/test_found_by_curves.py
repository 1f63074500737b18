"""A ball along round parts that are cut coarsely: how a round surface is cut into facets may not be felt as a kick."""

from __future__ import annotations

from dataclasses import replace

import curved
import numpy as np
import pytest
import shapes
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.surface import make_surface
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
    "half-spaces of nearly one direction, the first of them preferred": ("torus", 2, 14),
    "the same of a coarser one": ("torus", 1, 7),
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
    """Those of a saddle's top but for its rim; one that fills a brick stays a plane, and so do the base's."""
    surface = make_surface(curved.mesh_of(curved.saddle_mesh(8)), 30.0)
    top = surface.facet_patch[surface.facet_of[0]]
    round_ = np.flatnonzero(surface.facet_patch == top)
    middle = 1e3 * surface.mesh.vertices_m[surface.mesh.triangles].mean(axis=1)
    inner = np.zeros(len(surface.facet_patch), bool)
    inner[surface.facet_of[np.abs(middle[:, :2]).max(axis=1) < 30.0 - 60.0 / 8]] = True
    inner[surface.facet_patch != top] = False
    assert 0 < inner.sum() < len(round_)
    seen = np.zeros((2, 9, 9, 9), np.int32)
    seen[0], seen[1] = np.flatnonzero(inner)[:2]
    seen[1, 8, 8, 8] = seen[0, 0, 0, 0]
    expected = ~inner
    expected[seen[0, 0, 0, 0]] = True
    flat, felt_as_patch = flat_facets(surface, seen)
    np.testing.assert_array_equal(flat, expected)
    np.testing.assert_array_equal(felt_as_patch, ~expected)
    fine = replace(surface, fine=np.arange(surface.counts["patches"]) == top)
    flat, felt_as_patch = flat_facets(fine, seen)
    np.testing.assert_array_equal(flat, expected)
    np.testing.assert_array_equal(felt_as_patch, ~expected | (surface.facet_patch == top))
