"""Recordings of the servo: read, told, and run again through the firmware."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import CreaseError, RecordingError
from crease.base.native import error_text, ffi, lib, lib_of
from crease.base.records import record
from crease.base.scene import Scene

SUFFIX = ".crr"
MAGIC = b"CRRECORD"
_ALIGN = 64

RECORD = record(
    "cr_record",
    opened=("joints", "world_from_tool"),
    names={
        "pos_m": "position_m",
        "rot": "quaternion",
        "velocity_world_m_s": "velocity_m_s",
        "contact_force_world_N": "contact_force_N",
        "contact_torque_world_Nm": "contact_torque_Nm",
        "force_world_N": "force_N",
        "area_count": "areas",
        "zone_count": "zones",
    },
)
"""Of firmware/servo.h; joint units are m, rad, rad."""


@dataclass(frozen=True)
class Recording:
    """rows: structured array RECORD (n,). config: a cffi `cr_servo_config *`. cut_bytes: of a last record not whole."""

    rows: npt.NDArray[Any] = field(repr=False)
    config: Any = field(repr=False)
    scene_crc32: int
    source: str
    cut_bytes: int = 0
    """Of a last record that is not whole, left out: the recorder was stopped, or the disk was full."""

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
    """Whether the file starts like a recording, or has its suffix. False when it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC or path.suffix.lower() == SUFFIX
    except OSError:
        return False


def load_recording(path: Path) -> Recording:
    """The whole records of a file; one that is cut at the end is left out, see `cut_bytes`.

    Errors: RecordingError for a file that is no recording, of another version, or without a whole record.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    start = int(lib.CR_RECORDS_AT)
    if len(data) < start:
        raise RecordingError(f"{path}: {_short(data, start)}")
    head, config = ffi.new("cr_record_head *"), ffi.new("cr_servo_config *")
    code = _read_head(data, head, config)
    if code != lib.CR_OK:
        version = int.from_bytes(data[len(MAGIC) : len(MAGIC) + 4], "little")
        reason = {
            lib.CR_ERR_MAGIC: "is no recording of the servo",
            lib.CR_ERR_VERSION: f"is a recording of format {version}, not {lib.CR_RECORD_VERSION}",
            lib.CR_ERR_SIZE: "is damaged: its head tells other sizes than a recording of this format has",
            lib.CR_ERR_CONFIG: "is damaged: the settings in its head are none that a servo takes",
        }.get(code, error_text(code))
        raise RecordingError(f"{path}: {reason}; record it again with this version")
    body = len(data) - start
    whole, cut = divmod(body, RECORD.itemsize)
    if whole == 0:
        raise RecordingError(
            f"{path}: holds no whole record: {body} bytes after its head, of {RECORD.itemsize} each"
        )
    rows = np.frombuffer(data, dtype=RECORD, count=whole, offset=start).copy()
    return Recording(rows, config, int(head.scene_crc32), str(path), cut)


def _short(data: bytes, start: int) -> str:
    """What is wrong with a file of fewer bytes than the head of a recording has."""
    if not data:
        return "is an empty file; record it again"
    if MAGIC.startswith(data[: len(MAGIC)]):
        return f"is cut off within its head: {len(data)} of {start} bytes; record it again"
    return f"is no recording: {len(data)} bytes are less than its head"


def _read_head(data: bytes, head: Any, config: Any) -> int:
    """cr_record_head_read, by the extension that has the response of the recording.   Output: a cr_err."""
    code = int(lib.cr_record_head_read(data, head, config))
    if code != lib.CR_ERR_CONFIG:
        return code
    told = ffi.new("cr_servo_config *")
    at = ffi.sizeof("cr_record_head")
    ffi.buffer(told)[:] = data[at : at + ffi.sizeof("cr_servo_config")]
    try:
        native = lib_of(told.world.response)
    except CreaseError:
        return code
    own = native.own("cr_record_head", head), native.own("cr_servo_config", config)
    code = int(native.lib.cr_record_head_read(data, *own))
    for to, found in zip((head, config), own, strict=True):
        ffi.buffer(to)[:] = bytes(native.ffi.buffer(found))
    return code


def cut_warning(recording: Recording) -> list[str]:
    """One line when the file ends within a record, else none."""
    if not recording.cut_bytes:
        return []
    return [
        f"{recording.source}: is cut within a record: read up to tick {int(recording.rows['tick'][-1])}, "
        f"its last whole one; {recording.cut_bytes} bytes after it are left out"
    ]


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
        self.native = lib_of(self.config.world.response)
        """The extension that made it: its functions alone take `c`."""
        own, mine = self.native.own, self.native.lib
        own_scene = own("cr_scene", scene.handle)
        own_config = own("cr_servo_config", self.config)
        wrong = mine.cr_servo_config_error(own_config)
        if wrong:
            raise RecordingError(f"configuration of the servo: {ffi.string(wrong).decode('ascii')}")
        size = int(mine.cr_servo_size(own_scene, own_config))
        self._memory = np.zeros(size + _ALIGN, dtype=np.uint8)
        start = -self._memory.ctypes.data % _ALIGN
        memory = ffi.from_buffer("uint8_t[]", self._memory) + start
        servo = self.native.ffi.new("cr_servo **")
        code = int(mine.cr_servo_init(servo, memory, size, own_scene, own_config))
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
    own = servo.native.ffi
    result = own.new("cr_rerun *")
    out = np.zeros(len(recording), dtype=RECORD)
    servo.native.lib.cr_servo_rerun(
        servo.c,
        own.from_buffer("cr_record[]", recording.rows),
        len(recording),
        result,
        own.from_buffer("cr_record[]", out, require_writable=True),
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


def contact_ages(rows: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """How many felt poses ago that one was whose contact a tick felt, (n,); -1 in ticks that asked for none."""
    ages = rows["contact_late_ticks"].astype(np.int64)
    return np.where(ages == lib.CR_NOT_FELT, -1, ages)


def ages_text(rows: npt.NDArray[Any]) -> str:
    """One line on the ages of ticks in contact, for a person."""
    ages = contact_ages(rows)[rows["areas"] > 0]
    if not len(ages):
        return "none"
    if not ages.any():
        return "of each tick's own pose"
    return f"found {ages.mean():.1f} ticks before on average, {ages.max()} at most"


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
    columns["contact_late_ticks"] = contact_ages(rows)
    columns["wake_late_ns"] = rows["wake_late_ns"]
    columns["tick_ns"] = rows["tick_ns"]
    return columns
