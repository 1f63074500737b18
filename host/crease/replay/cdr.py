"""Messages of ROS 2 as bytes: little-endian CDR of version 1, and their definitions. No ROS is needed.

Source: OMG DDSI-RTPS 9.4.2.11 (encapsulation), CORBA 15.3 (CDR); definitions of common_interfaces, Apache 2.0.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

HEAD = b"\x00\x01\x00\x00"
"""CDR, little-endian, no options."""

_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
_VECTOR3 = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_PARTS = {
    "builtin_interfaces/Time": _TIME,
    "std_msgs/Header": _HEADER,
    "geometry_msgs/Vector3": _VECTOR3,
    "geometry_msgs/Point": _VECTOR3,
    "geometry_msgs/Quaternion": _QUATERNION,
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "sensor_msgs/PointField": "string name\nuint32 offset\nuint8 datatype\nuint32 count\n",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform\n",
}
_STAMPED = "std_msgs/Header header\n"
_WHOLE = {
    "geometry_msgs/msg/PoseStamped": _STAMPED + "geometry_msgs/Pose pose\n",
    "geometry_msgs/msg/WrenchStamped": _STAMPED + "geometry_msgs/Wrench wrench\n",
    "geometry_msgs/msg/Vector3Stamped": _STAMPED + "geometry_msgs/Vector3 vector\n",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "sensor_msgs/msg/JointState": _STAMPED
    + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    "sensor_msgs/msg/PointCloud2": _STAMPED
    + "uint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n"
    + "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
    "crease_msgs/msg/Contact": _STAMPED
    + "float64 depth_m\ngeometry_msgs/Vector3 normal\nuint32 areas\nuint32 zones\nuint32 contacts\nuint32 tick_ns\n",
    "crease_msgs/msg/ServoState": _STAMPED
    + "string mode\nstring[] faults\nstring[] limits\n"
    + "float64 energy_joules\nfloat64 margin\nfloat64 depth_m\nuint32 areas\nuint32 zones\nuint32 tick_ns\n",
}
"""Those of ROS, and two of our own for what it has no message for; their readers have the definition from the file."""

MESSAGES = tuple(_WHOLE)
"""Names of all messages. The place in it, from 1, is the schema's id in MCAP: new ones come last."""


def definition(name: str) -> str:
    """The whole definition of a message, with those of its parts, as MCAP's `ros2msg` has it.   Errors: KeyError."""
    found: dict[str, str] = {}

    def gather(text: str) -> None:
        for line in text.splitlines():
            kind = line.split(" ")[0].removesuffix("[]")
            if kind in _PARTS and kind not in found:
                found[kind] = _PARTS[kind]
                gather(_PARTS[kind])

    gather(_WHOLE[name])
    return _WHOLE[name] + "".join(
        f"{'=' * 80}\nMSG: {kind}\n{text}" for kind, text in found.items()
    )


class Message:
    """The bytes of one message, filled in the order of its definition."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def _put(self, form: str, *values: float | int) -> Message:
        size = struct.calcsize(f"<{form[-1]}")
        self._bytes += bytes(-len(self._bytes) % size)
        self._bytes += struct.pack(f"<{form}", *values)
        return self

    def uint32(self, *values: int) -> Message:
        """Whole numbers."""
        return self._put(f"{len(values)}I", *values)

    def uint8(self, value: int) -> Message:
        """A byte, or a truth value."""
        return self._put("B", value)

    def octets(self, data: bytes) -> Message:
        """A sequence of bytes, with its length before."""
        self.uint32(len(data))
        self._bytes += data
        return self

    def float64(self, values: Iterable[float]) -> Message:
        """Numbers one after the other: a vector, a quaternion x y z w."""
        listed = [float(v) for v in values]
        return self._put(f"{len(listed)}d", *listed)

    def floats(self, values: Iterable[float]) -> Message:
        """A sequence of numbers, with its length before."""
        listed = [float(v) for v in values]
        self.uint32(len(listed))
        return self.float64(listed) if listed else self

    def string(self, text: str) -> Message:
        """Text, with its length before and a zero behind."""
        data = text.encode("utf-8") + b"\x00"
        self.uint32(len(data))
        self._bytes += data
        return self

    def strings(self, texts: Sequence[str]) -> Message:
        """A sequence of texts."""
        self.uint32(len(texts))
        for text in texts:
            self.string(text)
        return self

    def header(self, time_ns: int, frame: str) -> Message:
        """std_msgs/Header."""
        self._put("i", time_ns // 1_000_000_000)
        return self.uint32(time_ns % 1_000_000_000).string(frame)

    def done(self) -> bytes:
        """The message with its encapsulation."""
        return HEAD + bytes(self._bytes)
