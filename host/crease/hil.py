"""The closed loop: the servo of the firmware at one end of the bus, simulated drives and operator at the other."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bus.drives import Drives, Fault, Frame, Params, Wire
from crease.errors import LoopError
from crease.measures import buzz_m_s2
from crease.native import ffi, lib
from crease.recording import RECORD, Recording, Servo, fault_names, load_recording, scene_crc32
from crease.scene import Scene
from crease.trajectory import Trajectory

F64 = npt.NDArray[np.float64]

PERIOD_NS = 1_000_000
DEADLINE_NS = 700_000
"""After SYNC: the tick starts then at the latest, as on a device (crease.bus.schedule)."""
LEAD_TICKS = 600
"""How long the hand takes from where the device stands to the first pose of the path."""
SETTLE_TICKS = 400
"""How long it then holds still before rendering starts: the drives are set up and calibrated meanwhile."""
START_LIMIT_TICKS = 10_000

MECHANISM = np.dtype(
    [
        ("tip_pos_m", np.float64, 3),
        ("tip_vel_m_s", np.float64, 3),
        ("tip_acc_m_s2", np.float64, 3),
        ("hand_force_N", np.float64, 3),
        ("hand_target_m", np.float64, 3),
        ("joint_torque", np.float64, 3),
    ]
)
"""What the simulator knows of the mechanism after each tick; frame of the base."""


@dataclass(frozen=True)
class LoopResult:
    """recording: every tick from the servo's first. mechanism: array MECHANISM, one row a tick; empty over a real bus.

    path_start: index of the first tick of the path.
    """

    recording: Recording
    mechanism: npt.NDArray[Any]
    path_start: int


def joints_along(path: Trajectory, config: Any) -> npt.NDArray[np.float32]:
    """Joints that put the tool at every pose of a path: (n, 6), m and rad.   Errors: LoopError: out of reach."""
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
            raise LoopError(
                f"{path.source}: row {i}: the device does not reach this pose; move the path or the base"
            )
        out[i, :3] = list(joints.joint)
        out[i, 3:] = list(joints.wrist_rad)
    return out


def hand_targets(path: Trajectory, config: Any) -> F64:
    """What the hand does along a path: tip in the base's frame, m, and unwrapped wrist, rad; (n, 6)."""
    joints = joints_along(path, config).astype(np.float64)
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
    from crease.trajectory import check_rows

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


class InProcess:
    """Servo and drives, frame by frame in lock-step: the same inputs give the same frames to the bit."""

    def __init__(
        self,
        scene: Scene,
        config: Any | None = None,
        params: Params | None = None,
        faults: Sequence[Fault] = (),
        deadline_ns: int = DEADLINE_NS,
        compute_ns: int = 0,
    ) -> None:
        """deadline_ns: after SYNC. compute_ns: how long a tick takes.

        Errors: CreaseError for a configuration, parameters or faults that are refused.
        """
        self.servo = Servo(scene, config)
        self.drives = Drives(params, faults=faults)
        self.wire = Wire(self.drives)
        self.deadline_ns, self.compute_ns = deadline_ns, compute_ns
        self.config = self.servo.config
        self.now_ns = 0
        self.rows: list[bytes] = []
        self.mechanism: list[tuple[Any, ...]] = []
        self.on_frame: Callable[[float, Frame], None] | None = None
        self._tx = ffi.new("cr_tx *")
        self._frame = ffi.new("cr_frame *")

    @property
    def mode(self) -> int:
        """CR_MODE_* after the last tick."""
        return int(lib.cr_servo_get_record(self.servo.c).mode)

    def command(self, bits: int) -> None:
        """CR_COMMAND_* for the next tick."""
        lib.cr_servo_input(self.servo.c, bits)

    def _to_drives(self, now_ns: int) -> None:
        for i in range(self._tx.count):
            item = self._tx.frames[i]
            frame = Frame(int(item.id), bytes(item.data[0 : item.size]))
            if self.on_frame is not None:
                self.on_frame(now_ns * 1e-9, frame)
            if not self.wire.put(frame, now_ns):
                self.command(int(lib.CR_INPUT_SEND_FAILED))

    def _to_servo(self, until_ns: int, stop_when_ready: bool) -> int:
        """What the wire brings until then, or until every drive has answered; gives when it was over."""
        while (came := self.wire.get(until_ns)) is not None:
            frame, at_ns = came
            if self.on_frame is not None:
                self.on_frame(at_ns * 1e-9, frame)
            self._frame.id, self._frame.size = frame.id, len(frame.data)
            ffi.memmove(self._frame.data, frame.data, len(frame.data))
            lib.cr_servo_rx(self.servo.c, self._frame)
            if stop_when_ready and lib.cr_servo_get_status(self.servo.c).ready:
                return at_ns
        return until_ns

    def tick(self, target: Sequence[float] | None = None) -> None:
        """One period. target: where the hand wants the tip (3, m, base) and how the wrist stands (3, rad).

        As a device does it: SYNC; the tick once every drive has answered, or at the deadline; frames on the wire in
        their true time.
        """
        self.now_ns += PERIOD_NS
        self._to_servo(self.now_ns, stop_when_ready=False)
        if target is not None:
            self.drives.target(target[:3], target[3:])
        lib.cr_servo_sync(self.servo.c, self.now_ns, self._tx)
        self._to_drives(self.now_ns)
        tick_ns = self._to_servo(self.now_ns + self.deadline_ns, stop_when_ready=True)
        state = self.drives.state
        lib.cr_servo_tick(self.servo.c, tick_ns, self.config.period_s, self._tx)
        self._to_drives(tick_ns + self.compute_ns)
        record = lib.cr_servo_get_record(self.servo.c)
        self.rows.append(bytes(ffi.buffer(record, RECORD.itemsize)))
        self.mechanism.append(
            (
                state.tip_pos_m,
                state.tip_vel_m_s,
                state.tip_acc_m_s2,
                state.hand_force_N,
                state.hand_target_m,
                state.joint_torque,
            )
        )

    def bring_up(self, lead: F64) -> None:
        """From power-on to idle, the hand on its way along `lead`.   Errors: LoopError when it does not get there."""
        for k in range(START_LIMIT_TICKS):
            self.tick(lead[min(k, len(lead) - 1)].tolist())
            if self.mode == lib.CR_MODE_IDLE and k >= len(lead):
                return
            if self.mode == lib.CR_MODE_FAULT:
                break
        status = lib.cr_servo_get_status(self.servo.c)
        why = ", ".join(fault_names(int(status.faults))) or "the drives do not come up"
        raise LoopError(f"the loop did not reach idle after {len(self.rows)} ticks: {why}")

    def result(self, path_start: int) -> LoopResult:
        """Everything so far."""
        rows = np.frombuffer(b"".join(self.rows), dtype=RECORD)
        recording = Recording(rows, self.config, scene_crc32(self.servo.scene), "in process")
        return LoopResult(recording, np.array(self.mechanism, dtype=MECHANISM), path_start)


def run_inprocess(
    scene: Scene,
    path: Trajectory,
    config: Any | None = None,
    params: Params | None = None,
    faults: Sequence[Fault] = (),
    on_frame: Callable[[float, Frame], None] | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> LoopResult:
    """The operator leads the tool along a path; both ends of the bus in this process. Deterministic.

    Errors: LoopError, or any CreaseError of scene, configuration and parameters.   Cost: about 0.4 ms a tick.
    """
    loop = InProcess(scene, config, params, faults)
    loop.on_frame = on_frame
    targets = hand_targets(resample(path), loop.config)
    loop.bring_up(lead_in(targets, loop.drives.state.tip_pos_m))
    loop.command(int(lib.CR_COMMAND_START))
    start = len(loop.rows)
    for k, target in enumerate(targets.tolist()):
        loop.tick(target)
        if k % 256 == 0:
            progress(k / len(targets))
    loop.command(int(lib.CR_COMMAND_STOP))
    loop.tick(targets[-1].tolist())
    return loop.result(start)


def find_creased() -> str:
    """The program creased: $CREASED, beside the checkout's build, or on the PATH.   Errors: LoopError."""
    built = Path(__file__).resolve().parents[2] / "build" / "gcc" / "creased"
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
    targets = hand_targets(resample(path), config)
    lead = lead_in(targets, np.array([0.0, np.sqrt(2.0) * 0.45, 0.0]))
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
    report: dict[str, object] = {
        "ticks": len(rows),
        "ticks_rendering": int(counters["ticks_rendering"]),
        "ticks_limited": int(counters["ticks_limited"]),
        "ticks_in_contact": int(np.count_nonzero(rendered["areas"])),
        "force_max_N": float(force_N.max(initial=0.0)),
        "depth_max_m": float(rendered["depth_m"].max(initial=0.0)),
        "energy_max_J": float(rendered["energy_J"].max(initial=0.0)),
        "faults": fault_names(int(first[0])) if len(first) else [],
        "missing": int(counters["missing"].sum()),
        "late": int(counters["late"]),
        "overruns": int(counters["overruns"]),
        "frames_lost": int(counters["rx_drops"]),
    }
    if len(result.mechanism):
        along = result.mechanism[result.path_start :]
        report["buzz_m_s2"] = buzz_m_s2(along["tip_acc_m_s2"])
        report["hand_force_max_N"] = float(
            np.linalg.norm(along["hand_force_N"], axis=1).max(initial=0.0)
        )
    return report
