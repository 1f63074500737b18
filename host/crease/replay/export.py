"""Tables and recordings as files that others open: MCAP with ROS 2 messages, Parquet, CSV, NPZ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from crease.base.errors import CreaseError, SceneError, TableError
from crease.base.scene import Scene
from crease.base.table import Column, check_columns, write_atomic, write_table
from crease.base.version import VERSION
from crease.replay.cdr import MESSAGES, Message, definition
from crease.replay.clouds import contact_topics, options_of_recording, path_of_recording
from crease.replay.recording import (
    Recording,
    cut_warning,
    fault_names,
    is_recording,
    limit_names,
    load_recording,
    mode_names,
    scene_crc32,
    to_columns,
)
from crease.replay.replay import ReplayOptions
from crease.replay.replay import to_columns as tick_columns
from crease.replay.ticks import read_ticks
from crease.replay.trajectory import Trajectory

FORMATS = ("mcap", "csv", "npz", "parquet")
TABLES = (".csv", ".npz")
WORLD, TOOL, ORIGIN, BASE = "world", "tool", "tool_origin", "device"
"""Frames. ORIGIN: at the tool's origin with the axes of the world; torques are about it."""
NO_TURN = (0.0, 0.0, 0.0, 1.0)
UNIT_TOLERANCE = 1e-3
"""How far the length of a quaternion may be from one."""
POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
DISPLAY = ("dx_m", "dy_m", "dz_m", "dqx", "dqy", "dqz", "dqw")
WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
CONTACT = ("depth_m", "nx", "ny", "nz", "areas", "zones", "contacts", "tick_ns")
JOINTS = ["guide", "upper_arm", "forearm"]

Columns = dict[str, Column]
Encode = Callable[[int, int], bytes | None]
"""Row and time in ns -> the bytes of a message; None: this row has nothing to say."""
Topics = dict[str, tuple[str, Encode]]
"""Topic -> name of its message, and how a row becomes one."""


def load(path: Path) -> tuple[Columns, Recording | None]:
    """The columns of a table of ticks, or of a recording and the recording itself.   Errors: CreaseError."""
    if is_recording(path):
        recording = load_recording(path)
        return to_columns(recording.rows), recording
    if path.exists() and path.suffix.lower() not in TABLES:
        raise TableError(
            f"{path}: is no recording (.crr) and no table (.csv, .npz); give one of them"
        )
    columns = read_ticks(path)
    if "t_s" not in columns:
        raise TableError(
            f"{path}: has no column t_s; give a table of `crease replay` or a recording"
        )
    check_columns(path, columns)
    if len(columns["t_s"]) == 0:
        raise TableError(f"{path}: has no rows; give at least one")
    return columns, None


def export(path: Path, kind: str, out: Path, scene: Scene | None = None) -> tuple[int, list[str]]:
    """Write `out` in one of FORMATS, whole or not at all.   Output: ticks, warnings.   Errors: CreaseError.

    scene: of a recording, for MCAP with contact points.
    """
    columns, recording = load(path)
    if scene is not None and (kind != "mcap" or recording is None):
        raise TableError(
            f"{path}: contact points (--scene) go from a recording to MCAP; a table's: `crease replay -o OUT.mcap`"
        )
    if kind == "mcap" and recording is not None:
        write_recording(out, recording, scene)
    elif kind == "mcap":
        _write_mcap(out, columns["t_s"], table_topics(columns, path))
    elif kind == "parquet":
        _write_parquet(out, columns)
    else:
        write_table(out, columns)
    return len(columns["t_s"]), [] if recording is None else cut_warning(recording)


def write_recording(out: Path, recording: Recording, scene: Scene | None = None) -> None:
    """A recording as MCAP; with its scene also what was touched.   Errors: CreaseError, also for another scene."""
    topics = recording_topics(recording)
    if scene is not None:
        if recording.scene_crc32 != scene_crc32(scene):
            raise SceneError(
                f"{scene.source}: is not the scene that {recording.source} was recorded with"
            )
        path, options = path_of_recording(recording), options_of_recording(recording)
        topics |= contact_topics(scene, path, options, recording.rows["areas"])
    _write_mcap(out, to_columns(recording.rows)["t_s"], topics)


def write_replay(
    out: Path, scene: Scene, path: Trajectory, rows: npt.NDArray[Any], options: ReplayOptions
) -> None:
    """A replay as MCAP, with what was touched.   rows: of `run_path`.   Errors: CreaseError."""
    topics = table_topics(tick_columns(path, rows), out) | contact_topics(scene, path, options)
    _write_mcap(out, path.t_s, topics)


def _matrix(columns: Columns, names: tuple[str, ...]) -> npt.NDArray[np.float64] | None:
    """The columns side by side, (n, m); None when one is missing."""
    if any(name not in columns for name in names):
        return None
    return np.stack([np.asarray(columns[name], np.float64) for name in names], axis=1)


def _stamped(name: str, frame: str, rows: npt.NDArray[np.float64]) -> tuple[str, Encode]:
    return (
        f"geometry_msgs/msg/{name}Stamped",
        lambda i, t: Message().header(t, frame).float64(rows[i]).done(),
    )


def _known(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which poses have a rotation, (n,): before the device is calibrated there is none, and tf2 refuses such."""
    known: npt.NDArray[np.bool_] = (
        np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1.0) < UNIT_TOLERANCE
    )
    return known


def _poses(rows: npt.NDArray[np.float64]) -> tuple[str, Encode]:
    known, (name, encode) = _known(rows), _stamped("Pose", WORLD, rows)
    return name, lambda i, t: encode(i, t) if known[i] else None


def _tf(rows: npt.NDArray[np.float64]) -> tuple[str, Encode]:
    known = _known(rows)

    def encode(i: int, t: int) -> bytes | None:
        if not known[i]:
            return None
        message = Message().uint32(2).header(t, WORLD).string(TOOL).float64(rows[i])
        return message.header(t, WORLD).string(ORIGIN).float64((*rows[i][:3], *NO_TURN)).done()

    return "tf2_msgs/msg/TFMessage", encode


def table_topics(columns: Columns, path: Path) -> Topics:
    """What a table of ticks can tell.   Errors: TableError when it has neither poses nor forces."""
    pose, wrench, display, contact = (_matrix(columns, n) for n in (POSE, WRENCH, DISPLAY, CONTACT))
    topics: Topics = {}
    if pose is not None:
        topics["/tf"] = _tf(pose)
        topics["/tool/pose"] = _poses(pose)
    if display is not None:
        topics["/tool/display_pose"] = _poses(display)
    if wrench is not None:
        topics["/contact/wrench"] = _stamped("Wrench", ORIGIN, wrench)
    if contact is not None:
        topics["/contact/state"] = "crease_msgs/msg/Contact", lambda i, t: _contact(contact[i], t)
    if not topics:
        raise TableError(
            f"{path}: has neither poses nor forces; give a table of `crease replay` or a recording"
        )
    return topics


def _contact(row: npt.NDArray[np.float64], t: int) -> bytes:
    counts = (int(count) for count in row[4:])
    return Message().header(t, WORLD).float64(row[:4]).uint32(*counts).done()


def recording_topics(recording: Recording) -> Topics:
    """What a recording of the servo can tell."""
    rows, modes = recording.rows, mode_names()
    pose = np.hstack([rows["position_m"], rows["quaternion"][:, [1, 2, 3, 0]]]).astype(np.float64)
    contact = np.hstack([rows["contact_force_N"], rows["contact_torque_Nm"]]).astype(np.float64)

    def joints(i: int, t: int) -> bytes:
        row = rows[i]
        message = Message().header(t, BASE).strings(JOINTS).floats(row["joint"])
        return message.floats(()).floats(row["torque"]).done()

    def servo(i: int, t: int) -> bytes:
        row: Any = rows[i]
        message = Message().header(t, BASE).string(modes[int(row["mode"])])
        message.strings(fault_names(int(row["faults"]))).strings(limit_names(int(row["limits"])))
        message.float64(row[name] for name in ("energy_J", "margin", "depth_m"))
        return message.uint32(*(int(row[name]) for name in ("areas", "zones", "tick_ns"))).done()

    return {
        "/tf": _tf(pose),
        "/tool/pose": _poses(pose),
        "/contact/wrench": _stamped("Wrench", ORIGIN, contact),
        "/device/force": _stamped("Vector3", WORLD, rows["force_N"].astype(np.float64)),
        "/device/joints": ("sensor_msgs/msg/JointState", joints),
        "/device/servo": ("crease_msgs/msg/ServoState", servo),
    }


def _times_ns(t_s: Column) -> Iterator[int]:
    """Since the first tick: MCAP and ROS have no time before zero."""
    return (round(1e9 * float(t)) for t in np.asarray(t_s, np.float64) - float(t_s[0]))


def _write_mcap(out: Path, t_s: Column, topics: Topics) -> None:
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise CreaseError(f"{out}: MCAP needs the package mcap: pip install mcap") from error

    def write(file: BinaryIO) -> None:
        writer = Writer(file)
        writer.start(profile="ros2", library=f"crease {VERSION}")
        schemas = {  # all there are, in one order: an id means the same message in every file
            name: writer.register_schema(name, "ros2msg", definition(name).encode())
            for name in MESSAGES
        }
        channels = {
            topic: writer.register_channel(topic, "cdr", schemas[name])
            for topic, (name, _) in topics.items()
        }
        for i, t in enumerate(_times_ns(t_s)):
            for topic, (_, encode) in topics.items():
                data = encode(i, t)
                if data is not None:
                    writer.add_message(
                        channels[topic], log_time=t, publish_time=t, sequence=i, data=data
                    )
        writer.finish()  # type: ignore[no-untyped-call]

    write_atomic(out, write)


def _write_parquet(out: Path, columns: Columns) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise CreaseError(
            f"{out}: Parquet needs the package pyarrow: pip install pyarrow"
        ) from error
    table = pyarrow.table({name: np.ascontiguousarray(column) for name, column in columns.items()})
    write_atomic(out, lambda file: parquet.write_table(table, file))
