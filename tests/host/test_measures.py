"""The measures: what they say of answers that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from crease.replay.measures import Felt, compare, torque_error_m

K = 500.0
FORCE_N = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 1.0]])
DEPTH_M = np.array([0.0, 1e-3, 2e-3])
ARM_M = np.array([0.03, 0.0, 0.0])
EXACT = Felt(FORCE_N, DEPTH_M, np.cross(ARM_M, FORCE_N))
MOVED_M = np.full(2, 1e-3)


def test_a_force_that_acts_elsewhere_is_wrong_by_its_arm_over_the_radius() -> None:
    """F / k = 2 mm, 30 mm beside where it should act, on a tool of radius 60 mm: 1 mm."""
    at_origin = Felt(FORCE_N, DEPTH_M, np.zeros((3, 3)))
    found = compare(at_origin, EXACT, K, 0.06, MOVED_M)
    assert (found.force_max_mm, found.depth_max_mm) == (0.0, 0.0)
    assert found.torque_max_mm == pytest.approx(1.0)
    assert found.torque_rms_mm == pytest.approx(math.sqrt((1.0 + 0.25) / 2)), (
        "over ticks in contact"
    )
    assert compare(EXACT, EXACT, K, 0.06, MOVED_M).torque_max_mm == 0.0


def test_torque_error_is_told_in_metres_of_force_over_stiffness_at_the_rim() -> None:
    torque_Nm = np.array([[0.0, 0.3, 0.0], [0.4, 0.0, 0.0]])
    error_m = torque_error_m(torque_Nm, np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]]), 1000.0, 0.1)
    assert error_m == pytest.approx([0.003, 0.005])


def test_answer_without_a_torque_has_no_torque_error() -> None:
    """A library that gives depth and normal only."""
    found = compare(Felt(FORCE_N, DEPTH_M), EXACT, K, math.nan, MOVED_M)
    assert math.isnan(found.torque_rms_mm)
    assert math.isnan(found.torque_max_mm)
    assert found.force_rms_mm == 0.0
