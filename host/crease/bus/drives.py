"""The simulated drives and mechanism (sim/) as a Python object: frames in, frames out, state at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from crease._sim import ffi, lib
from crease.base.errors import BusError

F64 = npt.NDArray[np.float64]

AXES = 3
BIT_NS = 1000
REACTION_NS = 20_000
"""1 Mbit/s; the jitter of a drive in the schedule."""
STATES = (
    "not ready to switch on", "switch on disabled", "ready to switch on", "switched on",
    "operation enabled", "quick stop active", "fault reaction active", "fault",
)  # fmt: skip
"""State of a drive by its number, in the words of CiA 402."""


def _fault_kinds() -> dict[str, int]:
    prefix = "CR_SIM_FAULT_"
    names = {
        n[len(prefix) :].lower(): int(getattr(lib, n)) for n in dir(lib) if n.startswith(prefix)
    }
    return {n: v for n, v in names.items() if n not in ("none", "count")}


FAULT_KINDS = {
    n: v for n, v in sorted(_fault_kinds().items(), key=lambda item: item[1]) if n != "s_max"
}
"""Kinds of fault by name: drop, delay, duplicate, reorder, corrupt, babble, silent, ..."""


class Frame(NamedTuple):
    """One classical frame with an 11-bit identifier."""

    id: int
    data: bytes


@dataclass(frozen=True)
class Fault:
    """One row of the fault table; see cr_sim_fault in sim/sim.h. axis None: every drive."""

    kind: str
    tick: int
    ticks: int = 1
    axis: int | None = None
    id: int = 0
    to_drives: bool = False
    value: int = 0


TICK_MAX = 2**32 - 1
ID_MAX = 0x7FF
VALUES = {
    "delay": (0, 2**31 - 1, "ticks"),
    "corrupt": (0, ID_MAX, "a byte, and 256 for each byte before it"),
    "babble": (0, 2**31 - 1, "frames a tick"),
    "encoder_jump": (-(2**31), 2**31 - 1, "counts"),
    "drive_error": (0, 0xFFFF, "an error code of 16 bits"),
}
"""What the value of a fault may be, and what it is; of other kinds it says nothing."""


def fault_out_of_range(fault: Fault) -> str:
    """Which part of a fault is out of which range; empty: none."""
    low, high, what = VALUES.get(fault.kind, (-(2**31), 2**31 - 1, ""))
    for name, value, least, most in (
        ("tick", fault.tick, 0, TICK_MAX),
        ("ticks", fault.ticks, 1, TICK_MAX),
        ("id", fault.id, 0, ID_MAX),
        ("axis", fault.axis or 0, 0, AXES - 1),
        ("value", fault.value, low, high),
    ):
        if not least <= value <= most:
            shown = f"{least:#x}..{most:#x}" if name == "id" else f"{least}..{most}"
            told = f"{value:#x}" if name == "id" else str(value)
            more = f", {what}" if name == "value" and what else ""
            return f"{name} {told} is out of range, {shown}{more}"
    return ""


@dataclass(frozen=True)
class MechState:
    """The mechanism as nobody on the bus knows it. Units: m, rad, N, N m, s; arrays of 3."""

    joint: F64
    joint_rate: F64
    joint_torque: F64
    counts: npt.NDArray[np.int32]
    wrist_counts: npt.NDArray[np.int32]
    tip_pos_m: F64
    tip_vel_m_s: F64
    tip_acc_m_s2: F64
    hand_force_N: F64
    hand_target_m: F64
    time_s: float
    limits: int


@dataclass(frozen=True)
class DriveState:
    """One drive."""

    nmt: int
    state: str
    statusword: int
    error_code: int
    torque_permille: int


@dataclass(frozen=True)
class Counters:
    """Since the start; see cr_sim_counters."""

    ticks: int
    frames_in: int
    frames_out: int
    frames_ignored: int
    frames_dropped: int
    faults_done: int


class Params:
    """Every parameter of device and operator, by the names of cr_sim_params in sim/sim.h.

    `Params(hand_mass_kg=0.3)` is the default device with one change; `linear=True` starts from the one without
    friction, lag and quantisation; `axes={"X": {"mass_kg": 5.0}}` changes one axis.
    Errors: BusError for a name that is not known or a number that is not finite.
    """

    def __init__(
        self, linear: bool = False, axes: dict[str, dict[str, float]] | None = None, **values: Any
    ) -> None:
        start = lib.cr_sim_params_linear() if linear else lib.cr_sim_params_default()
        self.c: Any = ffi.new("cr_sim_params *", start)
        for name, value in values.items():
            _assign(self.c, name, value)
        for axis, changes in (axes or {}).items():
            if axis not in "XYZ" or len(axis) != 1:
                raise BusError(f"axis '{axis}' is not known; use X, Y or Z")
            for name, value in changes.items():
                _assign(self.c.axes["XYZ".index(axis)], name, value)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.c, name)


def _assign(target: Any, name: str, value: Any) -> None:
    known = [
        field
        for field, _ in ffi.typeof(
            target[0] if ffi.typeof(target).kind == "pointer" else target
        ).fields
    ]
    known = [field for field in known if field not in ("axes", "padding")]
    if name not in known:
        raise BusError(f"parameter '{name}' is not known; use one of {', '.join(known)}")
    numbers = value if isinstance(value, Sequence) else [value]
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in numbers):
        raise BusError(f"parameter {name}: {value!r} is not a finite number")
    try:
        setattr(target, name, value)
    except (TypeError, OverflowError, IndexError) as error:
        raise BusError(f"parameter {name}: {value!r} does not fit: {error}") from error


class WristParams:
    """Motors of the wrist and the hand that turns it, by the names of cr_sim_wrist_params in sim/sim.h.

    Lists of three go by axis: yaw, pitch, roll.   Errors: BusError for a name that is not known, a number that is not
    finite, or a list that is not of three.
    """

    def __init__(self, **values: Any) -> None:
        self.c: Any = ffi.new("cr_sim_wrist_params *", lib.cr_sim_wrist_params_default())
        for name, value in values.items():
            if isinstance(value, Sequence) and len(value) != AXES:
                raise BusError(f"parameter {name}: {value!r} is not three numbers")
            _assign(self.c, name, value)


class Wrist:
    """The motored wrist, at rest at zero.   Errors: BusError for parameters out of range."""

    def __init__(self, params: WristParams) -> None:
        self.params = params
        self.c: Any = ffi.new("cr_sim_wrist *")
        if lib.cr_sim_wrist_init(self.c, params.c, [0.0] * AXES) != 0:
            raise BusError(
                "a parameter of the wrist is out of range; see cr_sim_wrist_params in sim/sim.h"
            )

    def advance(self, target_rad: Sequence[float], torque_Nm: Sequence[float]) -> None:
        """One period: where the hand wants the axes, and what the motors give."""
        lib.cr_sim_wrist_advance(self.c, list(target_rad), list(torque_Nm))

    def read(self, name: str) -> F64:
        """One array of cr_sim_wrist by its name."""
        return np.array(list(getattr(self.c, name)), dtype=np.float64)


class Drives:
    """Three drives, just switched on, with mechanism and operator behind them.

    Lock-step unless wall_clock: a SYNC moves the mechanism by one period. Time: us of any clock, never going back.
    Errors: BusError for parameters, faults or paths out of range.
    """

    def __init__(
        self,
        params: Params | None = None,
        *,
        wall_clock: bool = False,
        now_us: int = 0,
        faults: Sequence[Fault] = (),
        path: F64 | None = None,
    ) -> None:
        self.params = params or Params()
        made = lib.cr_sim_create(self.params.c, int(wall_clock), now_us)
        if made == ffi.NULL:
            raise BusError(
                "a parameter of the simulated device is out of range; see cr_sim_params in sim/sim.h"
            )
        self.c: Any = ffi.gc(made, lib.cr_sim_destroy)
        self._frame = ffi.new("cr_sim_frame *")
        self._out = ffi.new("cr_sim_frame[]", 64)
        self._state = ffi.new("cr_sim_state *")
        self._drive = ffi.new("cr_sim_drive *")
        if faults:
            self.set_faults(faults)
        if path is not None:
            self.set_path(path)

    def receive(self, frame: Frame, now_us: int) -> None:
        """A frame came over the bus."""
        _fill(self._frame, frame)
        lib.cr_sim_receive(self.c, self._frame, now_us)

    def poll(self, now_us: int) -> None:
        """Let time pass."""
        lib.cr_sim_poll(self.c, now_us)

    def send(self) -> list[Frame]:
        """Take what the drives send, in bus order."""
        frames: list[Frame] = []
        while count := lib.cr_sim_send(self.c, self._out, len(self._out)):
            for i in range(count):
                item = self._out[i]
                frames.append(Frame(item.id, bytes(item.data[0 : item.len])))
        return frames

    def target(self, tip_m: Sequence[float], wrist_rad: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Where the operator wants the tip, m, and how the wrist stands, rad."""
        lib.cr_sim_target(self.c, list(tip_m), list(wrist_rad))

    def set_path(self, rows: F64) -> None:
        """Targets, one row (tip m, wrist rad) a tick, from the first tick with every drive enabled; shape (n, 6)."""
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 6:
            raise BusError(f"operator path has shape {rows.shape}; it must be (n, 6): tip, wrist")
        if lib.cr_sim_set_path(self.c, ffi.from_buffer("double[]", rows), len(rows)) != 0:
            raise BusError("operator path has a number that is not finite")

    def set_faults(self, faults: Sequence[Fault]) -> None:
        """Replace the fault table.   Errors: BusError for a row that is out of range."""
        if len(faults) > lib.CR_SIM_FAULTS_MAX:
            raise BusError(f"{len(faults)} faults are too many; at most {lib.CR_SIM_FAULTS_MAX}")
        rows = ffi.new("cr_sim_fault[]", max(len(faults), 1))
        for row, fault in zip(rows, faults, strict=False):
            if fault.kind not in FAULT_KINDS:
                raise BusError(
                    f"fault '{fault.kind}' is not known; use one of {', '.join(FAULT_KINDS)}"
                )
            if wrong := fault_out_of_range(fault):
                raise BusError(f"fault {fault.kind}: {wrong}")
            row.kind, row.tick, row.ticks = FAULT_KINDS[fault.kind], fault.tick, fault.ticks
            row.axis = lib.CR_SIM_ANY_AXIS if fault.axis is None else fault.axis
            row.id, row.direction, row.value = fault.id, int(fault.to_drives), fault.value
        if lib.cr_sim_set_faults(self.c, rows, len(faults)) != 0:
            raise BusError("a fault is out of range; see cr_sim_fault in sim/sim.h")

    @property
    def state(self) -> MechState:
        """The mechanism now."""
        lib.cr_sim_read(self.c, self._state)
        values: dict[str, Any] = {}
        for field in fields(MechState):
            if field.name == "time_s":
                values["time_s"] = self._state.time_us * 1e-6
            elif field.name == "limits":
                values["limits"] = int(self._state.limits)
            else:
                kind = np.int32 if field.name.endswith("counts") else np.float64
                values[field.name] = np.array(list(getattr(self._state, field.name)), dtype=kind)
        return MechState(**values)

    def drive(self, axis: int) -> DriveState:
        """Drive 0, 1 or 2."""
        lib.cr_sim_read_drive(self.c, axis, self._drive)
        one = self._drive
        return DriveState(
            one.nmt, STATES[one.state], one.statusword, one.error_code, one.torque_permille
        )

    @property
    def counters(self) -> Counters:
        """What was counted since the start."""
        found = lib.cr_sim_count(self.c)
        return Counters(*(int(getattr(found, field.name)) for field in fields(Counters)))


class Wire:
    """The bus between a host and drives in its true time: bits of each frame, arbitration; see sim/wire.h.

    bit_ns 0: frames take no time. reaction_ns: how long a drive takes to answer.   Errors: BusError.
    """

    def __init__(
        self, drives: Drives, bit_ns: int = BIT_NS, reaction_ns: int = REACTION_NS, now_ns: int = 0
    ) -> None:
        made = lib.cr_wire_create(drives.c, bit_ns, reaction_ns, now_ns)
        if made == ffi.NULL:
            raise BusError("memory is out")
        self.drives = drives
        self.c: Any = ffi.gc(made, lib.cr_wire_destroy)
        self._frame = ffi.new("cr_sim_frame *")
        self._at = ffi.new("uint64_t *")

    def put(self, frame: Frame, now_ns: int) -> bool:
        """The host hands over a frame.   Output: False when its queue is full."""
        _fill(self._frame, frame)
        return bool(lib.cr_wire_put(self.c, self._frame, now_ns) == 0)

    def get(self, until_ns: int) -> tuple[Frame, int] | None:
        """The next frame that the host has received, and when, ns; None: none until then."""
        if not lib.cr_wire_get(self.c, until_ns, self._frame, self._at):
            return None
        item = self._frame
        return Frame(item.id, bytes(item.data[0 : item.len])), int(self._at[0])


def _fill(item: Any, frame: Frame) -> None:
    item.id, item.len = frame.id, len(frame.data)
    ffi.memmove(item.data, frame.data, len(frame.data))


def wire_bits(frame: Frame) -> int:
    """Bits of this very frame on the wire, stuff bits and interframe space included."""
    item = ffi.new("cr_sim_frame *")
    _fill(item, frame)
    return int(lib.cr_wire_bits(item))


class Mech:
    """The mechanism alone, without bus and drives.   Errors: BusError for parameters out of range."""

    def __init__(self, params: Params) -> None:
        made = lib.cr_mech_create(params.c)
        if made == ffi.NULL:
            raise BusError(
                "a parameter of the simulated device is out of range; see cr_sim_params in sim/sim.h"
            )
        self.params = params
        self.c: Any = ffi.gc(made, lib.cr_mech_destroy)
        self._state = ffi.new("cr_sim_state *")

    def command(self, torque: Sequence[float]) -> None:
        """Torque demand from now on: N, N m, N m."""
        lib.cr_mech_command(self.c, list(torque))

    def target(self, tip_m: Sequence[float], wrist_rad: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Where the operator wants the tip, m, and how the wrist stands, rad."""
        lib.cr_mech_target(self.c, list(tip_m), list(wrist_rad))

    def kick(self, axis: int, rate: float) -> None:
        """Give an axis a velocity: m/s or rad/s."""
        lib.cr_mech_kick(self.c, axis, rate)

    def advance(self, substeps: int) -> None:
        """Move on by some sub-steps."""
        lib.cr_mech_advance(self.c, substeps)

    def read(self, name: str) -> F64:
        """One array of cr_sim_state by its name."""
        lib.cr_mech_read(self.c, self._state)
        return np.array(list(getattr(self._state, name)), dtype=np.float64)

    def wall(self, axis: int, stiffness: float, count: int) -> F64:
        """Positions of the textbook virtual wall over `count` periods; see cr_mech_wall."""
        samples = np.zeros(count)
        lib.cr_mech_wall(self.c, axis, stiffness, ffi.from_buffer("double[]", samples), count)
        return samples
