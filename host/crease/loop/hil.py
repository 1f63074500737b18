"""The closed loop: the servo of the firmware at one end of the bus, simulated drives and operator at the other."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease._sim import ffi as sim_ffi
from crease._sim import lib as sim_lib
from crease.base.alone import Alone, alone
from crease.base.errors import LoopError
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.bus.drives import Drives, Fault, Frame, Params, Wire
from crease.loop.handle import HANDLE, Handle, HandleSetup, describe_handle
from crease.replay.measures import buzz_m_s2
from crease.replay.recording import (
    RECORD,
    Recording,
    Servo,
    ages_text,
    fault_names,
    load_recording,
    scene_crc32,
)
from crease.replay.trajectory import Trajectory, place_of_row

F64 = npt.NDArray[np.float64]

PERIOD_NS = 1_000_000
DEADLINE_NS = 700_000
"""After SYNC: the tick starts then at the latest, as on a device (crease.bus.schedule)."""
LEAD_TICKS = 600
"""How long the hand takes from where the device stands to the first pose of the path."""
SETTLE_TICKS = 400
"""How long it then holds still before rendering starts: the drives are set up and calibrated meanwhile."""
BRING_UP_TICKS = 10_000
"""At most, after the lead; the drives are enabled after about 600 from power-on."""
PROGRESS_TICKS = 256
_FAR = 3.0
"""Lengths of the arm from its base: nobody has a device there, the path is most likely in mm."""

MECHANISM = record("cr_lockstep_row")
"""What the simulator knows of the mechanism after each tick; frame of the base."""


@dataclass(frozen=True)
class LoopResult:
    """recording: every tick from the servo's first. mechanism: array MECHANISM, one row a tick; empty over a real bus.

    path_start: index of the first tick of the path. handle: array HANDLE, one row a tick; empty without a held tool.
    syncs, injected: of the simulated drives: SYNC frames that they saw, and how often a fault that was asked for acted.
    """

    recording: Recording
    mechanism: npt.NDArray[Any]
    path_start: int
    handle: npt.NDArray[Any] = field(default_factory=lambda: np.empty(0, dtype=HANDLE))
    syncs: int = 0
    injected: int = 0

    @property
    def along(self) -> slice:
        """The ticks of the path, without those after it, in which the servo is idle and gives no force."""
        busy = np.flatnonzero(self.recording.rows["mode"] != lib.CR_MODE_IDLE)
        return slice(self.path_start, int(busy[-1]) + 1 if len(busy) else None)


def joints_along(
    path: Trajectory, config: Any, given: Trajectory | None = None
) -> npt.NDArray[np.float32]:
    """Joints that put the tool at every pose of a path: (n, 6), m and rad.   Errors: LoopError: out of reach.

    given: what the path was resampled from, so that an error names its row.
    """
    joints, pose = ffi.new("cr_joints *"), ffi.new("cr_pose *")
    kinematics = ffi.new("cr_kinematics *")
    out = np.empty((len(path), 6), dtype=np.float32)
    for i, row in enumerate(path.rows.tolist()):
        (pose.pos_m.x, pose.pos_m.y, pose.pos_m.z) = row[1:4]
        (pose.rot.w, pose.rot.x, pose.rot.y, pose.rot.z) = row[4:8]
        reached = lib.cr_joints_from_pose(ffi.addressof(config, "arm"), pose, joints) == lib.CR_OK
        if reached:
            lib.cr_kinematics_solve(ffi.addressof(config, "arm"), joints, kinematics)
        if not reached or kinematics.range:
            raise LoopError(_out_of_reach(path, i, config, given or path))
        out[i, :3] = list(joints.joint)
        out[i, 3:] = list(joints.wrist_rad)
    return out


def _out_of_reach(path: Trajectory, at: int, config: Any, given: Trajectory) -> str:
    """Which row of `given` the pose `at` of a path is of, that the device does not reach, and the mend."""
    row = min(int(np.searchsorted(given.t_s, path.t_s[at] - 1e-9)), len(given) - 1)
    file = Path(given.source)
    place = place_of_row(file, row) if file.is_file() else f"{given.source}: row {row}"
    reach_m = float(config.arm.upper_m + config.arm.fore_m)
    base = config.arm.world_from_base.pos_m
    far = math.dist(path.position_m[at], (base.x, base.y, base.z)) > _FAR * reach_m
    mend = "are its positions in metres?" if far else "move the path or the base"
    return f"{place}: the device does not reach this pose; {mend}"


def hand_targets(path: Trajectory, config: Any, given: Trajectory | None = None) -> F64:
    """What the hand does along a path: tip in the base's frame, m, and unwrapped wrist, rad; (n, 6).

    given: as of joints_along.
    """
    joints = joints_along(path, config, given).astype(np.float64)
    upper, fore = float(config.arm.upper_m), float(config.arm.fore_m)
    u, f = joints[:, 1], joints[:, 2]
    return np.column_stack(
        [
            joints[:, 0],
            upper * np.cos(u) + fore * np.cos(f),
            upper * np.sin(u) + fore * np.sin(f),
            np.unwrap(joints[:, 3:], axis=0),
        ]
    )


def resample(path: Trajectory, period_s: float = 1e-3) -> Trajectory:
    """The path at one pose a period, in between by straight lines, quaternions normalised."""
    from crease.replay.trajectory import check_rows

    t_s = np.arange(path.t_s[0], path.t_s[-1] + 0.5 * period_s, period_s)
    quaternion = path.rows[:, 4:].copy()
    flips = np.cumprod(
        np.r_[1.0, np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0, -1.0, 1.0)]
    )
    columns = [path.rows[:, i] for i in (1, 2, 3)] + list((quaternion * flips[:, None]).T)
    rows = np.column_stack([t_s, *(np.interp(t_s, path.t_s, column) for column in columns)])
    rows[:, 4:] /= np.linalg.norm(rows[:, 4:], axis=1, keepdims=True)
    return check_rows(rows, path.source)


def lead_in(
    targets: F64, start_m: F64, lead_ticks: int = LEAD_TICKS, settle_ticks: int = SETTLE_TICKS
) -> F64:
    """Smooth way of the hand from where the device stands to the first row, then a rest: (n, 6)."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, lead_ticks))
    first = np.r_[start_m, np.zeros(3)]
    way = first + share[:, None] * (targets[0] - first)
    return np.concatenate([way, np.repeat(targets[:1], settle_ticks, axis=0)])


def operator_way(
    path: Trajectory, config: Any, start_m: F64, period_s: float = 1e-3
) -> tuple[F64, F64]:
    """What the hand does from where the device stands (tip, frame of the base): lead, then along the path; (n, 6) each.

    Errors: LoopError: out of reach.
    """
    targets = hand_targets(resample(path, period_s), config, path)
    return lead_in(targets, start_m), targets


class Loop:
    """Servo and drives in one process, in lock-step, all in C (host/native/lockstep.c): the same inputs give the same
    frames to the bit."""

    def __init__(
        self,
        scene: Scene,
        config: Any | None = None,
        params: Params | None = None,
        faults: Sequence[Fault] = (),
        at_once: bool = False,
        deadline_ns: int = DEADLINE_NS,
        compute_ns: int = 0,
        search_work: int = 0,
        handle: HandleSetup | None = None,
    ) -> None:
        """deadline_ns: after SYNC. compute_ns: how long a tick takes. at_once: no time from sample to torque but what
        the parameters declare.

        search_work: lookups of the search for contact beside each tick, for a config with late_max_ticks above 0.
        handle: of six axes, with a held tool; the servo's own contact is left out then.

        Errors: CreaseError for a configuration, parameters or faults that are refused.
        """
        self._alone = Alone("loop")
        if handle is not None:
            config = _without_contact(config)
        self.servo = Servo(scene, config)
        self.config = self.servo.config
        self._ffi, self._lib = self.servo.native.ffi, self.servo.native.lib
        self.drives = Drives(params, wall_clock=at_once, faults=faults)
        self._wire = Wire(self.drives, 0, 0) if at_once else Wire(self.drives)
        self._clock = self._ffi.new("cr_lockstep_clock *")
        self._clock.period_ns, self._clock.period_s = PERIOD_NS, self.config.period_s
        self._clock.deadline_ns, self._clock.compute_ns = deadline_ns, compute_ns
        self._clock.at_once, self._clock.search_work = int(at_once), search_work
        self._far = self._ffi.new("cr_lockstep_drives *")
        self._far.sim = self._pointer("void *", self.drives.c)
        self._far.wire = self._pointer("void *", self._wire.c)
        for name in ("wire_put", "wire_get", "sim_target", "sim_read"):
            address = sim_ffi.addressof(sim_lib, f"cr_{name}")
            setattr(self._far, name.split("_")[1], self._pointer("cr_lockstep_fn", address))
        self.handle: Handle | None = None
        """Of six axes, where the loop has one."""
        if handle is not None:
            delay_s = self.drives.params.torque_delay_s + (0.0 if at_once else 1e-9 * PERIOD_NS)
            self.handle = Handle(scene, self.config, handle, round(1e9 * delay_s / PERIOD_NS))
            self.handle.rest_at(self.drives.state.tip_pos_m)
            self._far.handle = self.handle.c
        self._handle_rows: list[npt.NDArray[Any]] = []
        self._records: list[npt.NDArray[Any]] = []
        self._rows: list[npt.NDArray[Any]] = []
        self.ticks = 0
        self.on_frame: Callable[[float, Frame], None] | None = None
        """Told of every frame: when, s, and what."""
        self._seen = self._ffi.callback(
            "void(uint64_t, cr_frame *)", self._see, onerror=self._catch
        )
        self._caught: BaseException | None = None

    @property
    def mode(self) -> int:
        """CR_MODE_* after the last tick."""
        return int(self._lib.cr_servo_get_record(self.servo.c).mode)

    @property
    def faults(self) -> int:
        """CR_SERVO_FAULT_* that hold the servo."""
        return int(self._lib.cr_servo_get_status(self.servo.c).faults)

    def command(self, bits: int) -> None:
        """CR_COMMAND_* for the next tick."""
        self._lib.cr_servo_input(self.servo.c, bits)

    def bump(self, impulse_Ns: F64) -> None:
        """Knock against the tip, frame of the base."""
        sim_lib.cr_sim_bump(self.drives.c, [float(v) for v in impulse_Ns])

    def _see(self, at_ns: int, frame: Any) -> None:
        if self.on_frame is not None:
            data = bytes(self._ffi.buffer(frame.data, frame.size))
            self.on_frame(at_ns * 1e-9, Frame(int(frame.id), data))

    def _catch(self, _kind: Any, error: BaseException, _trace: Any) -> None:
        self._caught = self._caught or error

    @alone
    def _run(self, targets: F64 | None, count: int, stop_modes: int) -> int:
        records, rows = np.zeros(count, dtype=RECORD), np.zeros(count, dtype=MECHANISM)
        handle_rows = np.zeros(count if self.handle else 0, dtype=HANDLE)
        own = self._ffi
        self._far.handle_rows = own.from_buffer("cr_handle_row[]", handle_rows)
        self._far.seen = own.NULL if self.on_frame is None else self._seen
        done = int(
            self._lib.cr_lockstep_run(
                self.servo.c,
                self._far,
                self._clock,
                own.NULL if targets is None else own.from_buffer("double[]", targets),
                count,
                stop_modes,
                own.from_buffer("cr_record[]", records, require_writable=True),
                own.from_buffer("cr_lockstep_row[]", rows, require_writable=True),
            )
        )
        self._records.append(records[:done])
        self._rows.append(rows[:done])
        self._handle_rows.append(handle_rows[:done])
        self.ticks += done
        caught, self._caught = self._caught, None
        if caught is not None:
            raise caught
        return done

    def run(self, targets: F64, stop_modes: int = 0) -> int:
        """One tick a row of targets (n, 6): where the hand wants the tip, m, frame of the base, and the wrist, rad.

        Ends early at a mode of stop_modes (bit 1 << CR_MODE_*).   Output: ticks done.   Errors: those of on_frame.
        """
        targets = np.ascontiguousarray(targets, dtype=np.float64)
        return self._run(targets, len(targets), stop_modes)

    def tick(self, target: Sequence[float] | None = None) -> None:
        """One period; without a target the hand wants what it wanted before."""
        self._run(None if target is None else np.array(target, dtype=np.float64), 1, 0)

    def bring_up(self, lead: F64) -> None:
        """From power-on to idle, the hand on its way along `lead` (n, 6), then at its end.   Errors: LoopError."""
        idle, fault = int(lib.CR_MODE_IDLE), int(lib.CR_MODE_FAULT)
        self.run(np.concatenate([lead, lead[-1:]]), 1 << fault)
        if self.mode not in (idle, fault):
            self.run(np.repeat(lead[-1:], BRING_UP_TICKS, axis=0), 1 << idle | 1 << fault)
        if self.mode != idle:
            why = ", ".join(fault_names(self.faults)) or "the drives do not come up"
            raise LoopError(f"the loop did not reach idle after {self.ticks} ticks: {why}")

    def latest(self, ticks: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Records and rows of the last run, at most `ticks`; they are views."""
        return self._records[-1][-ticks:], self._rows[-1][-ticks:]

    def latest_handle(self, ticks: int) -> npt.NDArray[Any]:
        """Rows of the handle in the last run, at most `ticks`; a view."""
        return self._handle_rows[-1][-ticks:]

    def drain(self) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Records and rows since the last call; they are not kept."""
        rows = [*self._records, np.zeros(0, RECORD)], [*self._rows, np.zeros(0, MECHANISM)]
        self._records, self._rows, self._handle_rows = [], [], []
        return np.concatenate(rows[0]), np.concatenate(rows[1])

    def result(self, path_start: int = 0) -> LoopResult:
        """Everything so far."""
        # As bytes: what C leaves free at the end of a record is copied too, and a recording is the same every time.
        rows = np.frombuffer(b"".join(part.tobytes() for part in self._records), dtype=RECORD)
        self._records, self._rows = [rows], [np.concatenate(self._rows)]
        recording = Recording(rows, self.config, scene_crc32(self.servo.scene), "in process")
        self._handle_rows = [np.concatenate(self._handle_rows)]
        seen = self.drives.counters
        return LoopResult(
            recording, self._rows[0], path_start, self._handle_rows[0], seen.ticks, seen.faults_done
        )

    def _pointer(self, kind: str, value: Any) -> Any:
        """An address of the simulator in the types of the servo's extension."""
        return self._ffi.cast(kind, int(sim_ffi.cast("uintptr_t", value)))


def _without_contact(config: Any | None) -> Any:
    """The same configuration with a servo that feels nothing of the world: a held tool does."""
    own = ffi.new("cr_servo_config *", config[0] if config else lib.cr_servo_config_default())
    own.world.stiffness_N_m = 0.0
    own.control.contact_damping_Ns_m = 0.0
    return own


def run_inprocess(
    scene: Scene,
    path: Trajectory,
    config: Any | None = None,
    params: Params | None = None,
    faults: Sequence[Fault] = (),
    on_frame: Callable[[float, Frame], None] | None = None,
    progress: Callable[[float], None] = lambda _: None,
    handle: HandleSetup | None = None,
    at_once: bool = False,
) -> LoopResult:
    """The operator leads the tool along a path; both ends of the bus in this process. Deterministic.

    handle, at_once: as of Loop.
    Errors: LoopError, or any CreaseError of scene, configuration and parameters.   Cost: about 0.07 ms a tick.
    """
    loop = Loop(scene, config, params, faults, at_once, handle=handle)
    loop.on_frame = on_frame
    lead, targets = operator_way(path, loop.config, loop.drives.state.tip_pos_m)
    loop.bring_up(lead)
    loop.command(int(lib.CR_COMMAND_START))
    start = loop.ticks
    for at in range(0, len(targets), PROGRESS_TICKS):
        progress(at / len(targets))
        loop.run(targets[at : at + PROGRESS_TICKS])
    loop.command(int(lib.CR_COMMAND_STOP))
    loop.tick(targets[-1].tolist())
    return loop.result(start)


def find_creased() -> str:
    """The program creased: $CREASED, beside the checkout's build, or on the PATH.   Errors: LoopError."""
    built = Path(__file__).resolve().parents[3] / "build" / "gcc" / "creased"
    found = os.environ.get("CREASED") or (str(built) if built.exists() else shutil.which("creased"))
    if not found:
        raise LoopError("creased is not built; run `make creased`, or name it in $CREASED")
    return found


def write_targets(path: Path, targets: F64) -> None:
    """A path file for `crease sim --operator`, one row a millisecond."""
    rows = np.column_stack([np.arange(len(targets)) * 1e-3, targets])
    with path.open("w", encoding="ascii") as file:
        file.write("t_s,x_m,y_m,z_m,yaw_rad,pitch_rad,roll_rad\n")
        np.savetxt(file, rows, fmt="%.9g", delimiter=",")


def run_socketcan(
    scene_path: Path,
    scene: Scene,
    path: Trajectory,
    channel: str,
    record: Path,
    stiffness_N_m: float,
) -> LoopResult:
    """The same over a SocketCAN interface: `creased` and `crease sim` as two programs.

    Errors: LoopError with what either program said.   Cost: the length of the path and about 3 s.
    """
    import sys

    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    lead, targets = operator_way(path, config, np.array([0.0, np.sqrt(2.0) * 0.45, 0.0]))
    seconds = (len(lead) + len(targets)) * 1e-3
    with tempfile.TemporaryDirectory(prefix="crease-hil-") as folder:
        operator, device = Path(folder) / "operator.csv", Path(folder) / "device.toml"
        write_targets(operator, np.concatenate([lead, targets]))
        device.write_text(
            f'[bus]\ninterface = "{channel}"\n[contact]\nstiffness_N_m = {stiffness_N_m!r}\n',
            encoding="ascii",
        )
        sim = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "crease",
                "sim",
                "-i",
                "socketcan",
                "-c",
                channel,
                "--operator",
                str(operator),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            command = [
                find_creased(),
                "--config",
                str(device),
                "--record",
                str(record),
                "--force",
                "--quiet",
            ]
            command += [
                "--start-after",
                f"{len(lead) * 1e-3}",
                "--seconds",
                f"{seconds + 1.5:.3f}",  # and the time in which the drives come up
                str(scene_path),
            ]
            said = subprocess.run(
                command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
            )
        finally:
            sim.terminate()
            sim_said = sim.communicate()[1]
    if said.returncode not in (0, 4):
        reason = (said.stderr.strip().splitlines() or ["creased failed"])[-1].removeprefix(
            "error: "
        )
        raise LoopError(
            f"{reason}" + (f"; {sim_said.strip().splitlines()[-1]}" if sim_said.strip() else "")
        )
    recording = load_recording(record)
    rendering = np.flatnonzero(
        np.isin(recording.rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))
    )
    if len(rendering) == 0:
        faults = ", ".join(fault_names(int(recording.rows["faults"][-1]))) or "no drives on the bus"
        raise LoopError(
            f"{channel}: rendering never started: {faults}; {sim_said.strip()}".rstrip("; ")
        )
    return LoopResult(recording, np.empty(0, dtype=MECHANISM), int(rendering[0]))


def describe(result: LoopResult) -> dict[str, object]:
    """Figures of a run: plain numbers and texts."""
    rows = result.recording.rows
    rendered = rows[np.isin(rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))]
    counters = rows["counters"][-1]
    force_N = np.linalg.norm(rendered["force_N"], axis=1)
    first = rows["faults"][np.flatnonzero(rows["faults"])[:1]]
    every = int(np.bitwise_or.reduce(rows["faults"], initial=0))
    report: dict[str, object] = {
        "ticks": len(rows),
        "ticks_rendering": int(counters["ticks_rendering"]),
        "ticks_limited": int(counters["ticks_limited"]),
        "ticks_in_contact": int(np.count_nonzero(rendered["areas"])),
        "contact": ages_text(rendered),
        "force_max_N": float(force_N.max(initial=0.0)),
        "depth_max_m": float(rendered["depth_m"].max(initial=0.0)),
        "energy_max_J": float(rendered["energy_J"].max(initial=0.0)),
        "faulted": every != 0,
        "faults": fault_names(every),
        "first_faults": fault_names(int(first[0])) if len(first) else [],
        "missing": int(counters["missing"].sum()),
        "late": int(counters["late"]),
        "overruns": int(counters["overruns"]),
        "frames_lost": int(counters["rx_drops"]),
    }
    if len(result.mechanism):
        along = result.mechanism[result.path_start :]
        touched = rows["areas"][result.path_start :] > 0
        report["buzz_m_s2"] = buzz_m_s2(along["tip_acc_m_s2"], touched)
        if len(result.handle):
            report |= describe_handle(result.handle[result.path_start :])
        report["hand_force_max_N"] = float(
            np.linalg.norm(along["hand_force_N"], axis=1).max(initial=0.0)
        )
    return report
