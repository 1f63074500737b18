"""A peg in its hole, by a hand that errs and yields: it goes in, and the held tool stays outside, by booleans."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from couple import ERROR_DEG, ERROR_MM, hole, peg, scene_of, wander
from crease import Scene
from crease.base.native import ffi, lib
from crease.replay.replay import CoupleOptions, ReplayOptions, World, make_coupled
from scipy.spatial.transform import Rotation
from test_couple_tick import inside_mm

F64 = npt.NDArray[np.float64]

TICKS, DOWN_MM = 1600, 25.0
HURRY_1_S, YIELD_MM_NS = 20.0, 30.0
"""The hand goes for its path so fast, and gives way so fast where it is pushed."""


def insert(scene: Scene, seed: int, friction: float) -> tuple[F64, F64, F64]:
    """Hand's and held tool's poses (n, 7), x y z in m and w x y z, and force in N (n,), of one path down the hole."""
    rng, seconds = np.random.default_rng(seed), 1e-3 * np.arange(TICKS)
    path_mm = ERROR_MM * wander(rng, seconds, 3)
    path_mm[:, 2] = np.linspace(3.0, -DOWN_MM - 5.0, TICKS)
    turns = Rotation.from_rotvec(np.radians(ERROR_DEG) * wander(rng, seconds, 3))
    options = ReplayOptions(2000.0, couple=CoupleOptions(friction=friction))
    world, coupled = World(scene, options), make_coupled(options)
    out, hands, helds, forces = ffi.new("cr_couple_output *"), [], [], []
    at_mm = path_mm[0].copy()
    for want_mm, turn in zip(path_mm, turns.as_quat(), strict=True):
        f = out.force_world_N
        at_mm += 1e-3 * (HURRY_1_S * (want_mm - at_mm) + YIELD_MM_NS * np.array([f.x, f.y, f.z]))
        hand = [*(1e-3 * at_mm), turn[3], *turn[:3]]
        pose = ffi.new("cr_pose *", {"pos_m": tuple(hand[:3]), "rot": tuple(hand[3:])})
        lib.cr_couple_tick(coupled, world.handle, pose, 1e-3, out)
        assert out.faults == 0
        held = out.held
        hands.append(hand)
        helds.append(
            [*(getattr(held.pos_m, k) for k in "xyz"), *(getattr(held.rot, k) for k in "wxyz")]
        )
        f = out.force_world_N
        forces.append(float(np.linalg.norm([f.x, f.y, f.z])))
    return np.array(hands), np.array(helds), np.array(forces)


def depth_mm(static: Any, tool: Any, pose: F64) -> float:
    """How deep the overlap is at a pose."""
    return inside_mm(static, tool, pose[:3], Rotation.from_quat([*pose[4:], pose[3]]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("play_mm", "seed", "friction"), [(0.4, 1, 0.0), (0.4, 3, 0.1), (0.1, 1, 0.0)]
)
def test_peg_goes_in_by_a_hand_that_errs(play_mm: float, seed: int, friction: float) -> None:
    static, tool = hole(play_mm), peg()
    scene = scene_of(static, tool, 1.4, 1.0)
    hands, helds, forces = insert(scene, seed, friction)
    assert helds[-1, 2] < -1e-3 * DOWN_MM
    first = int(np.argmax(forces > 0))
    assert first > 0
    assert depth_mm(static, tool, hands[first]) > 0.0  # nothing is felt before it touches
    deep = [depth_mm(static, tool, held) for held in helds[first::80]]
    assert max(deep) < 1e3 * scene.meta.error_max_m  # no deeper than the image is wrong
    assert float(np.median(deep)) < 0.02
