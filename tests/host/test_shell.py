"""Parts of a point shell that are made for many clusters at once: the same as made for each alone."""

from __future__ import annotations

import numpy as np
import pytest
from crease.bake import sphere_tree
from crease.bake.pieces import _beside
from crease.bake.sphere_tree import ball, balls


@pytest.mark.parametrize("block", [1, 7, 2048])
def test_spheres_of_many_sets_are_those_of_each_to_the_bit(
    block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sphere_tree, "BLOCK", block)
    rng = np.random.default_rng(5)
    points, extra = rng.normal(0.0, 0.02, (40, 16, 3)), rng.uniform(0.0, 0.01, (40, 16))
    points[3] = points[3, :1]
    centre, radius = balls(points, extra)
    for i in range(40):
        alone, reach = ball(points[i], extra[i])
        assert np.array_equal(centre[i], alone)
        assert radius[i] == reach


def test_clusters_beside_each_other_have_near_samples() -> None:
    rng = np.random.default_rng(6)
    points, cluster = rng.uniform(0.0, 1.0, (300, 3)), rng.integers(0, 30, 300)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= 0.1
    first, second = _beside(points, cluster, 0.1)
    assert len(first) == cluster.max() + 2
    assert first[-1] == len(second)
    for i in range(cluster.max() + 1):
        others = second[first[i] : first[i + 1]]
        expected = np.unique(cluster[near[cluster == i].any(axis=0)])
        assert others.tolist() == [j for j in expected if j != i]
