"""A handle of six axes in the closed loop: the device's three, a motored wrist beside the bus, and a held tool between.

The C half is host/native/handle.c, the wrist sim/wrist.c, the controller firmware/couple/passivity.c.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from crease._sim import ffi as sim_ffi
from crease._sim import lib as sim_lib
from crease.base.errors import LoopError
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.bus.drives import Wrist, WristParams
from crease.replay.replay import CoupleOptions, ReplayOptions
from crease.replay.replay import World as Engine

HANDLE = record("cr_handle_row")
"""One tick of the handle, of host/native/handle.h; frame of the world."""

DELAY_TICKS_MAX = int(lib.CR_COUPLE_DELAY_MAX)
WRIST_SHARE = 0.9
"""Of the weakest motor's torque that a wrench about the tip may have: what is left over is for rounding."""


@dataclass(frozen=True)
class HandleSetup:
    """What a handle may change.

    stiffness_N_m, damping_Ns_m, couple: of the coupling. wrist: its motors and the hand that turns it. passivity:
    fields of cr_couple_passivity_config by name; what is not given follows from coupling, device and wrist.
    """

    stiffness_N_m: float = 1000.0
    damping_Ns_m: float = 0.0
    couple: CoupleOptions = field(default_factory=CoupleOptions)
    wrist: WristParams = field(default_factory=WristParams)
    passivity: Mapping[str, float] = field(default_factory=dict)

    def stiffer(self, stiffness_N_m: float, stiffness_Nm_rad: float) -> HandleSetup:
        """The same with other springs."""
        couple = replace(self.couple, stiffness_Nm_rad=stiffness_Nm_rad)
        return replace(self, stiffness_N_m=stiffness_N_m, couple=couple)


class Handle:
    """Coupling, controller and wrist of one loop. Owned by that loop."""

    def __init__(self, scene: Scene, config: Any, setup: HandleSetup, delay_ticks: int) -> None:
        """config: the servo's `cr_servo_config *`, of the extension that ships. delay_ticks: from a sample to what it
        makes act; 1 over the bus.

        Errors: SceneError for springs out of range, BusError for a wrist, LoopError for a controller that is refused.
        """
        self.setup = setup
        options = ReplayOptions(setup.stiffness_N_m, setup.damping_Ns_m, couple=setup.couple)
        self._engine = Engine(scene, options)
        self.wrist = Wrist(setup.wrist)
        self._passivity = ffi.new("cr_couple_passivity *")
        limits = _passivity_config(config, setup, delay_ticks)
        wrong = lib.cr_couple_passivity_config_error(limits)
        if wrong:
            raise LoopError(f"controller of six axes: {ffi.string(wrong).decode()}")
        lib.cr_couple_passivity_init(self._passivity, limits)
        self._config = config
        self.c: Any = ffi.new("cr_handle *")
        self.c.coupled, self.c.world = self._engine.coupled, self._engine.handle
        self.c.passivity, self.c.config = self._passivity, config
        self.c.wrist = _pointer("void *", self.wrist.c)
        advance = sim_ffi.addressof(sim_lib, "cr_sim_wrist_advance")
        self.c.advance = _pointer("cr_handle_advance", advance)
        self.c.delay_ticks = delay_ticks

    def rest_at(self, tip_m: npt.NDArray[np.float64]) -> None:
        """Where the hand is before it is told anything, frame of the base."""
        self.c.target[0:3] = tip_m.tolist()

    def bump(self, impulse_Nms: npt.NDArray[np.float64]) -> None:
        """Knock against the handle: N m s about each axis of the wrist."""
        sim_lib.cr_sim_wrist_bump(self.wrist.c, impulse_Nms.tolist())


def _pointer(kind: str, value: Any) -> Any:
    """An address of the simulator in the types of the firmware's extension."""
    return ffi.cast(kind, int(sim_ffi.cast("uintptr_t", value)))


def _passivity_config(config: Any, setup: HandleSetup, delay_ticks: int) -> Any:
    """Settings of the controller: both springs alike, the device's limits and own friction.   Errors: LoopError."""
    if not 0 <= delay_ticks <= DELAY_TICKS_MAX:
        raise LoopError(f"delay of {delay_ticks} periods; give 0 to {DELAY_TICKS_MAX}")
    found = ffi.new("cr_couple_passivity_config *", lib.cr_couple_passivity_config_default())
    found.reach_m = np.sqrt(setup.couple.stiffness_Nm_rad / setup.stiffness_N_m)
    found.damping_max_Ns_m = config.control.passivity_damping_max_Ns_m
    found.own_damping_Ns_m = config.control.own_damping_Ns_m
    found.own_damping_Nms_rad = min(setup.wrist.c.viscous_Nms_rad)
    found.force_max_N = config.control.force_max_N
    found.torque_max_Nm = max(WRIST_SHARE * min(setup.wrist.c.torque_max_Nm), 1e-6)
    found.delay_ticks = delay_ticks
    for name, value in setup.passivity.items():
        if name not in dir(found):
            raise LoopError(f"'{name}' is not known; see cr_couple_passivity_config in couple.h")
        setattr(found, name, value)
    return found


def handle_columns(
    rows: npt.NDArray[Any], recorded: npt.NDArray[Any]
) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of ticks, by name: those of a replay, and of a run of the loop what is not the same.

    Shapes: rows HANDLE (n,); recorded: the servo's, RECORD (n,).
    """
    from crease.replay.recording import to_columns

    columns = to_columns(recorded)
    force_N = rows["contact_force_N"].astype(np.float64)
    size_N = np.linalg.norm(force_N, axis=1, keepdims=True)
    vectors = {
        ("fx_N", "fy_N", "fz_N"): rows["force_N"],
        ("tx_Nm", "ty_Nm", "tz_Nm"): rows["torque_Nm"],
        ("nx", "ny", "nz"): force_N / np.where(size_N > 0.0, size_N, 1.0),
        ("dx_m", "dy_m", "dz_m"): rows["held_pos_m"],
        ("dqw", "dqx", "dqy", "dqz"): rows["held_rot"],
        ("x_m", "y_m", "z_m"): rows["hand_pos_m"],
        ("qw", "qx", "qy", "qz"): rows["hand_rot"],
        ("contact_fx_N", "contact_fy_N", "contact_fz_N"): rows["contact_force_N"],
        ("contact_tx_Nm", "contact_ty_Nm", "contact_tz_Nm"): rows["contact_torque_Nm"],
        ("motor_yaw_Nm", "motor_pitch_Nm", "motor_roll_Nm"): rows["motor_Nm"],
        ("wrist_yaw_rad", "wrist_pitch_rad", "wrist_roll_rad"): rows["wrist_rad"],
        ("hand_yaw_Nm", "hand_pitch_Nm", "hand_roll_Nm"): rows["hand_torque_Nm"],
    }
    for names, values in vectors.items():
        columns.update(zip(names, np.ascontiguousarray(values.T), strict=True))
    columns |= {
        "depth_m": rows["drawn_m"],
        "inside_m": rows["inside_m"],
        "energy_J": rows["energy_J"],
        "areas": rows["pressing"],
        "contacts": rows["pressing"],
        "zones": rows["contacts"],
        "nodes": rows["lookups"],
        "points": rows["near"],
        "couple_late": rows["late"],
        "couple_limits": rows["limits"],
        "couple_faults": rows["faults"],
        "tick_ns": rows["tick_ns"],
    }
    return columns


def describe_handle(rows: npt.NDArray[Any]) -> dict[str, object]:
    """Figures of the ticks of a path: plain numbers."""
    force_N, torque_Nm = (
        np.linalg.norm(rows[name], axis=1).max(initial=0.0) for name in ("force_N", "torque_Nm")
    )
    return {
        "ticks_in_contact": int(np.count_nonzero(rows["pressing"])),
        "ticks_couple_limited": int(np.count_nonzero(rows["limits"])),
        "ticks_couple_passivity": int(
            np.count_nonzero(rows["limits"] & int(lib.CR_COUPLE_LIMIT_PASSIVITY))
        ),
        "ticks_late": int(np.count_nonzero(rows["late"])),
        "ticks_left_out": int(np.count_nonzero(rows["left_out"])),
        "couple_faults": int(np.bitwise_or.reduce(rows["faults"])) if len(rows) else 0,
        "force_max_N": float(force_N),
        "torque_max_Nm": float(torque_Nm),
        "hand_torque_max_Nm": float(np.abs(rows["hand_torque_Nm"]).max(initial=0.0)),
        "depth_max_m": float(rows["drawn_m"].max(initial=0.0)),
        "inside_max_m": float(rows["inside_m"].max(initial=0.0)),
        "energy_max_J": float(rows["energy_J"].max(initial=0.0)),
        "couple_tick_p50_ns": float(np.percentile(rows["tick_ns"], 50)) if len(rows) else 0.0,
        "couple_tick_p99_ns": float(np.percentile(rows["tick_ns"], 99)) if len(rows) else 0.0,
    }
