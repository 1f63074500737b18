"""Recordings of the servo: read, told, and run again through the firmware."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.errors import RecordingError
from crease.native import error_text, ffi, lib
from crease.scene import Scene

SUFFIX = ".crr"
MAGIC = b"CRRECORD"
_ALIGN = 64

_FRAME = np.dtype([("id", "<u2"), ("size", "u1"), ("flags", "u1"), ("data", "u1", 8)])
_COUNTERS = np.dtype(
    [
        ("ticks_rendering", "<u4"),
        ("ticks_limited", "<u4"),
        ("limits", "<u4", 8),
        ("faults", "<u4"),
        ("missing", "<u4", 3),
        *(
            (name, "<u4")
            for name in (
                "late",
                "twice",
                "malformed",
                "alien",
                "babbled",
                "emcy",
                "sdo_retries",
                "overruns",
                "send_failed",
                "rx_drops",
                "wrist_missing",
            )
        ),
    ]
)
RECORD = np.dtype(
    [
        ("tick", "<u4"),
        ("inputs", "<u4"),
        ("sync_ns", "<u8"),
        ("now_ns", "<u8"),
        ("period_s", "<f4"),
        ("rx_drops", "<u4"),
        ("rx_babbled", "<u4"),
        ("frame_count", "<u4"),
        ("frames", _FRAME, 12),
        ("mode", "<u4"),
        ("faults", "<u4"),
        ("limits", "<u4"),
        ("counts", "<i4", 3),
        ("wrist_counts", "<i4", 3),
        ("status", "<u2", 3),
        ("target", "<i2", 3),
        ("actual", "<i2", 3),
        ("fresh", "<u2"),
        ("joint", "<f4", 3),
        ("wrist_rad", "<f4", 3),
        ("position_m", "<f4", 3),
        ("quaternion", "<f4", 4),
        ("velocity_m_s", "<f4", 3),
        ("contact_force_N", "<f4", 3),
        ("contact_torque_Nm", "<f4", 3),
        ("force_N", "<f4", 3),
        ("torque", "<f4", 3),
        ("energy_J", "<f4"),
        ("depth_m", "<f4"),
        ("margin", "<f4"),
        ("areas", "<u4"),
        ("zones", "<u4"),
        ("counters", _COUNTERS),
        ("trouble_axis", "<u4"),
        ("sdo_object", "<u4"),
        ("sdo_found", "<u4"),
        ("sdo_wanted", "<u4"),
        ("sdo_abort", "<u4"),
        ("spare", "<u4", 2),
        ("wake_late_ns", "<u4"),
        ("tick_ns", "<u4"),
    ],
    align=True,
)
"""`cr_record` of firmware/servo.h, field by field; joint units are m, rad, rad."""


def check_layout() -> bool:
    """Whether RECORD is laid out as the C struct: asked by the tests."""
    c = dict(ffi.typeof("cr_record").fields)
    pairs = {
        "frames": "frames",
        "mode": "mode",
        "target": "target",
        "joint": "joints",
        "position_m": "world_from_tool",
        "force_N": "force_world_N",
        "torque": "torque",
        "counters": "counters",
        "trouble_axis": "trouble_axis",
        "sdo_abort": "sdo_abort",
        "wake_late_ns": "wake_late_ns",
    }
    fields = RECORD.fields
    assert fields is not None
    return RECORD.itemsize == ffi.sizeof("cr_record") and all(
        fields[ours][1] == c[theirs].offset for ours, theirs in pairs.items()
    )


@dataclass(frozen=True)
class Recording:
    """rows: structured array RECORD (n,). config: a cffi `cr_servo_config *`. cut_bytes: of a last record not whole."""

    rows: npt.NDArray[Any] = field(repr=False)
    config: Any = field(repr=False)
    scene_crc32: int
    source: str
    cut_bytes: int = 0

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True)
class Rerun:
    """What running a recording again gave. different: ticks whose outputs are not the same to the bit."""

    records: int
    different: int
    first: int | None
    gap: bool
    rows: npt.NDArray[Any] = field(repr=False)


def is_recording(path: Path) -> bool:
    """Whether the file starts like a recording. False when it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def load_recording(path: Path) -> Recording:
    """A file that ends in the midst of a record is read up to the last whole one.

    Errors: RecordingError for a file that is none, of another version, or without one whole record.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    start = int(lib.CR_RECORDS_AT)
    if len(data) < start:
        raise RecordingError(f"{path}: is no recording: {len(data)} bytes are less than its head")
    head, config = ffi.new("cr_record_head *"), ffi.new("cr_servo_config *")
    code = int(lib.cr_record_head_read(data, head, config))
    if code != lib.CR_OK:
        reason = {
            lib.CR_ERR_MAGIC: "is no recording of the servo",
            lib.CR_ERR_VERSION: f"is a recording of format {head.version or '?'}, not {lib.CR_RECORD_VERSION}",
        }.get(code, error_text(code))
        raise RecordingError(f"{path}: {reason}; record it again with this version")
    body = len(data) - start
    count = body // RECORD.itemsize
    if count == 0:
        raise RecordingError(f"{path}: has no whole record: {body} bytes are less than one")
    rows = np.frombuffer(data, dtype=RECORD, offset=start, count=count).copy()
    cut = body - count * RECORD.itemsize
    return Recording(rows, config, int(head.scene_crc32), str(path), cut)


def recording_bytes(rows: npt.NDArray[Any], config: Any, scene: Scene) -> bytes:
    """The bytes of a recording file."""
    head = np.zeros(int(lib.CR_RECORDS_AT), dtype=np.uint8)
    lib.cr_record_head_write(
        config,
        ffi.from_buffer(scene.image),
        len(scene.image),
        ffi.from_buffer("uint8_t[]", head, require_writable=True),
    )
    return head.tobytes() + np.ascontiguousarray(rows).tobytes()


def scene_crc32(scene: Scene) -> int:
    """The checksum that a recording keeps of its scene."""
    return int(ffi.cast("struct cr_img_header *", ffi.from_buffer(scene.image)).crc32)


class Servo:
    """A servo of the firmware over a scene, in memory of its own. Not for two threads at once."""

    def __init__(self, scene: Scene, config: Any | None = None) -> None:
        """config: a cffi `cr_servo_config *`; the assumed device when it is not given.   Errors: RecordingError."""
        self.scene = scene
        self.config = config or ffi.new("cr_servo_config *", lib.cr_servo_config_default())
        wrong = lib.cr_servo_config_error(self.config)
        if wrong != ffi.NULL:
            raise RecordingError(f"configuration of the servo: {ffi.string(wrong).decode('ascii')}")
        size = int(lib.cr_servo_size(scene.handle, self.config))
        self._memory = np.zeros(size + _ALIGN, dtype=np.uint8)
        start = -self._memory.ctypes.data % _ALIGN
        memory = ffi.from_buffer("uint8_t[]", self._memory) + start
        servo = ffi.new("cr_servo **")
        code = int(lib.cr_servo_init(servo, memory, size, scene.handle, self.config))
        if code != lib.CR_OK:
            raise RecordingError(f"{scene.source}: {error_text(code)}")
        self.c: Any = servo[0]


def rerun(recording: Recording, scene: Scene) -> Rerun:
    """Feed the inputs of a recording to a fresh servo and compare every output to the bit.

    Errors: RecordingError when the scene is another, or the recording does not start with the servo's first tick.
    Cost: about 5 us a tick in contact.
    """
    if recording.scene_crc32 != scene_crc32(scene):
        raise RecordingError(
            f"{recording.source}: was recorded with another scene than {scene.source} "
            f"(checksum {recording.scene_crc32:08x}, not {scene_crc32(scene):08x})"
        )
    servo = Servo(scene, recording.config)
    result = ffi.new("cr_rerun *")
    out = np.zeros(len(recording), dtype=RECORD)
    lib.cr_servo_rerun(
        servo.c,
        ffi.from_buffer("cr_record[]", recording.rows),
        len(recording),
        result,
        ffi.from_buffer("cr_record[]", out, require_writable=True),
    )
    if result.records == 0:
        raise RecordingError(
            f"{recording.source}: starts at tick {int(recording.rows['tick'][0])}, not at the servo's first"
        )
    return Rerun(
        records=int(result.records),
        different=int(result.different),
        first=int(result.first) if result.different else None,
        gap=bool(result.gap),
        rows=out[: result.records],
    )


def mode_names() -> list[str]:
    """Names of the modes, by number."""
    return [ffi.string(lib.cr_mode_text(i)).decode("ascii") for i in range(int(lib.CR_MODE_COUNT))]


def fault_names(bits: int) -> list[str]:
    """Names of the faults in a word of fault bits."""
    return _bit_names(bits, lib.cr_servo_fault_text)


def limit_names(bits: int) -> list[str]:
    """Names of the limits in a word of limit bits."""
    return _bit_names(bits, lib.cr_limit_text)


def _bit_names(bits: int, text: Any) -> list[str]:
    return [ffi.string(text(1 << i)).decode("ascii") for i in range(32) if bits >> i & 1]


def _missing(rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """States that did not come in time, in each tick."""
    total = rows["counters"]["missing"].sum(axis=1).astype(np.int64)
    return np.diff(total, prepend=total[:1])


def to_columns(rows: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of ticks, by name: what of a record is worth plotting."""
    columns: dict[str, npt.NDArray[Any]] = {
        "t_s": (rows["sync_ns"] - rows["sync_ns"][0]).astype(np.float64) * 1e-9
    }
    vectors = {
        ("x_m", "y_m", "z_m"): "position_m",
        ("qw", "qx", "qy", "qz"): "quaternion",
        ("vx_m_s", "vy_m_s", "vz_m_s"): "velocity_m_s",
        ("fx_N", "fy_N", "fz_N"): "force_N",
        ("contact_fx_N", "contact_fy_N", "contact_fz_N"): "contact_force_N",
        ("joint_x_m", "joint_y_rad", "joint_z_rad"): "joint",
        ("tau_x_N", "tau_y_Nm", "tau_z_Nm"): "torque",
        ("target_x", "target_y", "target_z"): "target",
    }
    for names, name in vectors.items():
        columns.update(zip(names, rows[name].T, strict=True))
    for name in ("energy_J", "depth_m", "margin", "areas", "zones", "mode", "limits", "faults"):
        columns[name] = rows[name]
    waited_ns = (rows["now_ns"] - rows["sync_ns"]).astype(np.float64)
    columns["states_us"] = 1e-3 * waited_ns
    columns["torque_us"] = 1e-3 * (waited_ns + rows["tick_ns"])
    columns["states_missing"] = _missing(rows)
    columns["wake_late_ns"] = rows["wake_late_ns"]
    columns["tick_ns"] = rows["tick_ns"]
    return columns
