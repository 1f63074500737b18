"""Distances from the planes of a corner, as the bake asks for them (host/native/surface/solid.c)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from crease.bake.kinds import Probes, distance_from_planes

F64 = npt.NDArray[np.float64]

EDGES_M = np.array([0.01, -0.02, 0.03])
PLANES = np.column_stack([np.eye(3), EDGES_M])
"""A corner: the solid is where each coordinate is below that of EDGES_M."""


def points(count: int = 3000) -> F64:
    return np.asarray(EDGES_M + np.random.default_rng(8).uniform(-0.02, 0.02, (count, 3)))


def of_corner(at: F64) -> F64:
    """Signed distance to the corner: nearest is a face, an edge or the vertex."""
    above = at - EDGES_M
    outside = np.linalg.norm(np.maximum(above, 0.0), axis=1)
    return np.asarray(np.where((above > 0).any(axis=1), outside, above.max(axis=1)))


def test_planes_give_the_distance_to_a_corner_and_to_its_complement() -> None:
    at = points()
    np.testing.assert_allclose(distance_from_planes(1.0, PLANES, at), of_corner(at), atol=1e-15)
    outside = np.column_stack([-np.eye(3), -EDGES_M])
    np.testing.assert_allclose(distance_from_planes(-1.0, outside, at), -of_corner(at), atol=1e-15)
    np.testing.assert_allclose(
        distance_from_planes(1.0, PLANES[:1], at), at[:, 0] - EDGES_M[0], atol=1e-15
    )


def test_planes_of_a_sharp_oblique_wedge_give_the_distance_to_its_edge() -> None:
    turn = np.radians(25.0)
    planes = np.array(
        [[0.0, np.sin(turn), np.cos(turn), 0.0], [0.0, np.sin(turn), -np.cos(turn), 0.0]]
    )
    at = np.array([[0.004, 0.003, 0.0], [-0.001, 0.002, 1e-4]])
    np.testing.assert_allclose(
        distance_from_planes(1.0, planes, at), np.hypot(at[:, 1], at[:, 2]), rtol=1e-12
    )


@pytest.mark.parametrize(("off_m", "kept"), [(0.9e-6, 5), (1.1e-6, 4)])
def test_rows_of_probes_agree_when_none_of_them_is_off(off_m: float, kept: int) -> None:
    at = points(5 * 40).reshape(5, 40, 3)
    exact = of_corner(at.reshape(-1, 3)).reshape(5, 40)
    near = np.abs(exact) < 5e-3
    exact[3, np.flatnonzero(near[3])[-1]] += off_m
    exact[2, np.flatnonzero(~near[2])[0]] += 5e-6
    probes = Probes(at, exact, 5e-3, 1e-6, 1e-5)
    assert len(probes.agreeing(1.0, PLANES, np.arange(5))) == kept
    assert probes.agreeing(-1.0, PLANES, np.array([4, 1])).tolist() == []
