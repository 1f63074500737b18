"""Methods under the benchmark: the coupled tick, by path or by tick; the hand that yields; the loop with a delay."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.scene import Scene
from crease.replay.replay import CoupleOptions, ReplayOptions, World, make_coupled, run_path
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation
from six_judge import Felt

F64 = npt.NDArray[np.float64]


class Method(Protocol):
    """What answers tick by tick."""

    def tick(self, pose: F64) -> tuple[F64, F64]:
        """A pose (7,) of the hand.   Output  wrench (6,) on the hand about the tool's origin, held pose (7,)."""
        ...


class Coupled:
    """`cr_couple_tick`."""

    def __init__(self, scene: Scene, springs: tuple[float, float], friction: float = 0.0) -> None:
        options = ReplayOptions(springs[0], couple=CoupleOptions(springs[1], friction=friction))
        self.memory: Any = make_coupled(options)
        self._world = World(scene)
        self.out = ffi.new("cr_couple_output *")

    def tick(self, pose: F64) -> tuple[F64, F64]:
        """See Method."""
        at = pose.tolist()
        hand = ffi.new("cr_pose *", {"pos_m": at[:3], "rot": at[3:]})
        lib.cr_couple_tick(self.memory, self._world.handle, hand, 1e-3, self.out)
        f, t, p = self.out.force_world_N, self.out.torque_world_Nm, self.out.held
        held = np.array([p.pos_m.x, p.pos_m.y, p.pos_m.z, p.rot.w, p.rot.x, p.rot.y, p.rot.z])
        return np.array([f.x, f.y, f.z, t.x, t.y, t.z]), held


def run_coupled(
    scene: Scene,
    springs: tuple[float, float],
    path: Trajectory,
    friction: float = 0.0,
    repeat: int = 1,
) -> tuple[Felt, npt.NDArray[Any]]:
    """The path in C, and its rows."""
    options = ReplayOptions(springs[0], couple=CoupleOptions(springs[1], friction=friction))
    rows = run_path(scene, path, options, repeat)
    wrench = np.hstack([rows["force_N"], rows["torque_Nm"]]).astype(np.float64)
    held = np.hstack([rows["display_pos_m"], rows["display_rot"]]).astype(np.float64)
    return Felt(wrench, held, rows["tick_ns"].astype(np.int64)), rows


def run_method(method: Method, path: Trajectory) -> Felt:
    """Tick by tick."""
    found = [method.tick(pose) for pose in path.rows[:, 1:]]
    none = np.zeros(len(found), np.int64)
    return Felt(np.array([w for w, _ in found]), np.array([h for _, h in found]), none)


def guide(method: Method, hand: dict[str, float], place_m: F64, turns: Rotation) -> tuple[F64, F64]:
    """A hand that yields follows targets: mass on a spring and damper to them, pushed by the wrench.

    Semi-implicit Euler, one step a tick.   Output  held poses (n, 7), wrenches (n, 6).
    """
    h = hand["period_s"]
    x, q = place_m[0].copy(), turns[0]
    v, w = np.zeros(3), np.zeros(3)
    held, felt = np.empty((len(place_m), 7)), np.empty((len(place_m), 6))
    for i in range(len(place_m)):
        pose = np.concatenate([x, q.as_quat()[[3, 0, 1, 2]]])
        felt[i], held[i] = method.tick(pose)
        pull = hand["stiffness_N_m"] * (place_m[i] - x)
        twist = hand["stiffness_Nm_rad"] * (turns[i] * q.inv()).as_rotvec()
        # The damper acts at the new velocity: no step is too long for it.
        v = (v + h / hand["mass_kg"] * (pull + felt[i, :3])) / (
            1.0 + h * hand["damping_Ns_m"] / hand["mass_kg"]
        )
        w = (w + h / hand["inertia_kgm2"] * (twist + felt[i, 3:])) / (
            1.0 + h * hand["damping_Nms_rad"] / hand["inertia_kgm2"]
        )
        x = x + h * v
        q = Rotation.from_rotvec(h * w) * q
    return held, felt


LOOP_MASS_KG, LOOP_DAMPING_NS_M, LOOP_DELAY, LOOP_TICKS = 0.5, 6.0, 1, 1500
"""A handle on one axis, 1 ms late, that is knocked."""


def settles(scene: Scene, stiffness_N_m: float, height_m: float) -> bool:
    """Whether the handle, pressed with 5 N straight down on what is below and knocked, comes to rest.

    The method sees where the handle is at each millisecond; its force acts LOOP_DELAY ticks later and is held.
    height_m: of the tool's origin where it touches.
    """
    method = Coupled(scene, (stiffness_N_m, 5.0))
    h, steps = 1e-3, 10
    z, v, late = height_m - 5.0 / stiffness_N_m, -0.01, [5.0] * LOOP_DELAY
    heights = np.empty(LOOP_TICKS)
    method.tick(np.array([0.0, 0.0, height_m + 1e-4, 1.0, 0.0, 0.0, 0.0]))
    for i in range(LOOP_TICKS):
        late.append(float(method.tick(np.array([0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0]))[0][2]))
        force = late.pop(0)
        for _ in range(steps):
            v += h / steps / LOOP_MASS_KG * (force - 5.0 - LOOP_DAMPING_NS_M * v)
            z += h / steps * v
        heights[i] = z
    swing = np.abs(heights - np.mean(heights[-200:]))
    return bool(swing[-300:].max() < 0.5 * swing[100:400].max())


def largest_stiffness_N_m(scene: Scene, height_m: float) -> float:
    """That settles, to 1 %."""
    low, high = 500.0, 16000.0
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        if settles(scene, middle, height_m):
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))
