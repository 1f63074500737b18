"""The closed loop of crease.loop.hil a second time, frame by frame in Python: the referee of host/native/lockstep.c."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.scene import Scene
from crease.bus.drives import Drives, Fault, Frame, Wire
from crease.loop.hil import DEADLINE_NS, MECHANISM, PERIOD_NS
from crease.replay.recording import RECORD, Servo


class FrameByFrame:
    """Servo, wire and drives; `records`, `mechanism` and `frames` keep what passed."""

    def __init__(self, scene: Scene, faults: Iterable[Fault] = (), compute_ns: int = 0) -> None:
        self.servo = Servo(scene)
        self.drives = Drives(None, faults=tuple(faults))
        self.wire = Wire(self.drives)
        self.compute_ns, self.now_ns = compute_ns, 0
        self.frames: list[tuple[float, Frame]] = []
        self._records: list[bytes] = []
        self._rows: list[tuple[Any, ...]] = []
        self._tx, self._frame = ffi.new("cr_tx *"), ffi.new("cr_frame *")

    def _to_drives(self, now_ns: int) -> None:
        for i in range(self._tx.count):
            item = self._tx.frames[i]
            frame = Frame(int(item.id), bytes(item.data[0 : item.size]))
            self.frames.append((now_ns * 1e-9, frame))
            if not self.wire.put(frame, now_ns):
                lib.cr_servo_input(self.servo.c, lib.CR_INPUT_SEND_FAILED)

    def _to_servo(self, until_ns: int, stop_when_ready: bool) -> int:
        while (came := self.wire.get(until_ns)) is not None:
            frame, at_ns = came
            self.frames.append((at_ns * 1e-9, frame))
            self._frame.id, self._frame.size = frame.id, len(frame.data)
            ffi.memmove(self._frame.data, frame.data.ljust(8, b"\0"), 8)
            lib.cr_servo_rx(self.servo.c, self._frame)
            if stop_when_ready and lib.cr_servo_get_status(self.servo.c).ready:
                return at_ns
        return until_ns

    def tick(self, target: list[float]) -> None:
        """SYNC; the tick once every drive has answered, or at the deadline."""
        self.now_ns += PERIOD_NS
        self._to_servo(self.now_ns, stop_when_ready=False)
        self.drives.target(target[:3], target[3:])
        lib.cr_servo_sync(self.servo.c, self.now_ns, self._tx)
        self._to_drives(self.now_ns)
        tick_ns = self._to_servo(self.now_ns + DEADLINE_NS, stop_when_ready=True)
        s = self.drives.state
        lib.cr_servo_tick(self.servo.c, tick_ns, self.servo.config.period_s, self._tx)
        self._to_drives(tick_ns + self.compute_ns)
        self._records.append(
            bytes(ffi.buffer(lib.cr_servo_get_record(self.servo.c), RECORD.itemsize))
        )
        tip = (s.tip_pos_m, s.tip_vel_m_s, s.tip_acc_m_s2)
        self._rows.append((*tip, s.hand_force_N, s.hand_target_m, s.joint_torque))

    @property
    def records(self) -> npt.NDArray[Any]:
        return np.frombuffer(b"".join(self._records), dtype=RECORD)

    @property
    def mechanism(self) -> npt.NDArray[Any]:
        return np.array(self._rows, dtype=MECHANISM)
