"""`crease.Coupling`: a tool that stays outside, held by the hand on a spring in six degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from crease.base.alone import Alone, alone, stays
from crease.base.arguments import check_number
from crease.base.attitude import to_matrix
from crease.base.errors import SceneError
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.replay.replay import CoupleOptions, ReplayOptions
from crease.replay.replay import World as Engine
from crease.replay.trajectory import POSE_NUMBERS, Trajectory, put_pose
from crease.replay.world import PERIOD_S, Replay, path_of

F32 = npt.NDArray[np.float32]

OUTPUT = record("cr_couple_output")
COUPLED = record("cr_coupled")
"""Of firmware/couple.h."""

HELD_DONE_M = 1e-6
"""What a point of the held tool may be left behind by at the end of a tick that is not late."""

POINTS = np.dtype(
    [("point_world_m", "<f4", (3,)), ("normal_world", "<f4", (3,)), ("gap_m", "<f4")], align=True
)
"""A point of the tool that is held, its plane's normal, and how far it is above that plane; below 0 it presses."""


class Held:
    """What a coupling answered to its last tick: views into its memory, which its next tick writes over.

    Keep a number or `.copy()` of an array, not the view. Frames: world is the frame of the static mesh. Units: SI. All
    numbers are finite.
    """

    __slots__ = {
        "_cell": None,
        "_state": None,
        "force_N": "(3,) on the hand's tool, N, world frame.",
        "held_position_m": "(3,) of the held tool, m, world frame: what the eye should see.",
        "held_quaternion": "(4,) of the held tool, unit, scalar first, world_from_tool.",
        "torque_Nm": "(3,) about the origin of the hand's tool, N m, world frame.",
    }

    force_N: F32
    torque_Nm: F32
    held_position_m: F32
    held_quaternion: F32

    def __init__(self, memory: npt.NDArray[Any], state: npt.NDArray[Any]) -> None:
        """memory: structured array OUTPUT (1,). state: COUPLED (1,). Both written by the coupling."""
        self._cell = memory[0]
        self._state = state[0]
        self.force_N = memory["force_world_N"][0]
        self.torque_Nm = memory["torque_world_Nm"][0]
        self.held_position_m = memory["held"]["pos_m"][0]
        self.held_quaternion = memory["held"]["rot"][0]

    @property
    def pressing(self) -> int:
        """Points that press; 0: the wrench is zero."""
        return int(self._cell["pressing"])

    @property
    def inside_m(self) -> float:
        """How deep the deepest point of the held tool is behind the plane that it must not pass; 0: none is."""
        return float(self._cell["inside_m"])

    @property
    def faults(self) -> int:
        """Bits of what was refused, latched until `Coupling.reset`; 0: none. The wrench is zero meanwhile.

        1: pose not finite, quaternion not of unit length within 1 %, or beyond 1e4 m. 2: period not in (0, 1] s.
        4: a number that is none.
        """
        return int(self._cell["faults"])

    @property
    def late(self) -> bool:
        """The tick ended before the held tool had caught up with the hand: the next one goes on."""
        return float(self._state["stats"]["left_m"]) > HELD_DONE_M

    @property
    def left_out(self) -> int:
        """Samples and steps that the tick had no room for; 0: none."""
        stats = self._state["stats"]
        return int(stats["dropped"]) + int(stats["refused"])

    @property
    def points(self) -> npt.NDArray[Any]:
        """Points that hold the tool, a structured array (n,): point_world_m, normal_world, both (3,), and gap_m.

        A point whose gap_m is below 0 presses, along its normal; one above is near. Not a view: made anew when asked.
        """
        contacts = self._state["contacts"][: int(self._state["contact_count"])]
        used = [
            (contact["normal_world"], point)
            for contact in contacts
            for point in contact["point_tool_m"][: int(contact["point_count"])]
        ]
        out = np.zeros(len(used), POINTS)
        if used:
            turn = to_matrix(self.held_quaternion.astype(np.float64)[None])[0]
            tool_m = np.array([point for _, point in used], np.float64)
            out["point_world_m"] = self.held_position_m + tool_m @ turn.T
            out["normal_world"] = [normal for normal, _ in used]
            out["gap_m"] = self._state["couple"]["points"]["gap_m"][: len(used)]
        return out

    @property
    def stats(self) -> dict[str, float]:
        """Work done and trouble met in the tick, by the names of `cr_couple_stats`."""
        stats = self._state["stats"]
        return {name: stats[name].item() for name in stats.dtype.names}

    def __repr__(self) -> str:
        x, y, z = self.force_N.tolist()
        told = f"pressing={self.pressing}, faults={self.faults}"
        return f"Held(force_N=[{x:.6g}, {y:.6g}, {z:.6g}], {told})"


class Coupling:
    """A scene with a tool that is held outside the obstacle, and a spring in six degrees of freedom to the hand.

        coupling = crease.Coupling(scene, stiffness=2000.0, stiffness_turn=5.0, friction=0.3)
        out = coupling.tick([0, 0, 0.008, 1, 0, 0, 0])   # out.force_N, out.torque_Nm, out.held_position_m, out.points

    The wrench is the spring's alone: never stiffer than it is, whatever is touched. `World` answers from the depth of
    the hand's tool itself. One thread at a time, another gets a CreaseError; couplings may share a scene.
    """

    def __init__(
        self,
        scene: Scene | str | Path,
        *,
        stiffness: float = 1000.0,
        stiffness_turn: float = 5.0,
        damping: float = 0.0,
        damping_turn: float = 0.0,
        friction: float = 0.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """A coupling that holds no tool yet: the first tick begins at the hand's pose.

        scene: baked, opened, or the path of its file. stiffness: k_t, N/m, 1 to 1e6. stiffness_turn: k_r, N m/rad, 1e-3
        to 1e4. damping: N s/m, 0 to 1e4, of the hand's velocity against the held tool. damping_turn: N m s/rad, 0 to
        100. friction: Coulomb's coefficient, 0 to 1. centre: (3,) where the springs are tied, m, frame of the tool.
        Errors   SceneError for a setting out of range.
        Cost     about 140 kB and a millisecond.
        Source   firmware/couple.h, firmware/couple/DESIGN.md.
        """
        for what, value, low, high, unit in (
            ("stiffness", stiffness, 1.0, 1e6, "N/m"),
            ("stiffness_turn", stiffness_turn, 1e-3, 1e4, "N m/rad"),
            ("damping", damping, 0.0, 1e4, "N s/m"),
            ("damping_turn", damping_turn, 0.0, 100.0, "N m s/rad"),
            ("friction", friction, 0.0, 1.0, ""),
        ):
            check_number(what, value, low, high, unit, SceneError)
        try:
            x, y, z = (float(value) for value in centre)
        except (TypeError, ValueError):
            raise SceneError("centre: give x, y and z in m, in the frame of the tool") from None
        self.scene: Scene = scene if isinstance(scene, Scene) else Scene.open(scene)
        couple = CoupleOptions(stiffness_turn, damping_turn, friction, (x, y, z))
        self._options = ReplayOptions(stiffness, damping, couple=couple)
        self._alone = Alone("coupling")
        self._engine = Engine(self.scene, self._options)
        self._handle = self._engine.coupled
        self._pose = np.zeros(POSE_NUMBERS, np.float32)
        self._pose_c = ffi.cast("cr_pose *", ffi.from_buffer(self._pose))
        memory = np.zeros(1, OUTPUT)
        memory["held"]["rot"][0, 0] = 1.0
        self._out_c = ffi.cast("cr_couple_output *", ffi.from_buffer(memory))
        self._out = Held(memory, np.frombuffer(ffi.buffer(self._handle), COUPLED))

    def __reduce__(self) -> NoReturn:
        stays("Coupling", "send the path of its scene file, and make one there")

    @property
    def handle(self) -> Any:
        """The cffi `cr_coupled *`, for functions of `crease.base.native.lib`."""
        return self._handle

    @alone
    def tick(self, pose: npt.ArrayLike, period_s: float = PERIOD_S) -> Held:
        """One tick: where the hand's tool is now, and how long since the last tick.

        pose: (7,) x y z in m, unit quaternion w x y z of world_from_tool.
        Output   the coupling's Held, written over by the next tick. A pose that is not sane latches a fault there, and
                 the wrench is zero until `reset`: the loop goes on.
        Errors   TrajectoryError when pose is not 7 numbers; CreaseError while another thread is in this coupling.
        Cost     firmware/couple/DESIGN.md "Cost", and 2 us.
        """
        put_pose(pose, self._pose)
        lib.cr_couple_tick(self._handle, self._engine.handle, self._pose_c, period_s, self._out_c)
        return self._out

    @alone
    def replay(self, poses: npt.ArrayLike | Trajectory, period_s: float = PERIOD_S) -> Replay:
        """Many ticks in one call, from where the held tool is; `reset` first for a fresh one.

        poses: as for `World.replay`.
        Output   one row a tick: the wrenches of `tick` to the bit. depth_m is how far the spring is drawn along;
                 display_pos_m and display_rot of `rows` are the held tool; overflow counts what was left out.
        Errors   as `World.replay`.
        """
        path = poses if isinstance(poses, Trajectory) else path_of(poses, period_s)
        return Replay(path, self._engine.run(path), self._options)

    @alone
    def reset(self) -> None:
        """Let go, and forget faults: the next tick begins at the hand's pose."""
        self._engine.reset()
