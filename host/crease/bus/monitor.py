"""Frames of the motor bus as names and numbers, and a table of what is going on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import can

from crease.bus.dictionary import Axis, Dictionary, Pdo
from crease.bus.schedule import frame_bits

Values = dict[str, float | int | str]
"""What a frame says: field name with unit -> value."""

NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}
NMT_COMMANDS = {
    1: "start",
    2: "stop",
    128: "enter pre-operational",
    129: "reset node",
    130: "reset communication",
}
WINDOW_S = 1.0
"""Rates and load are taken over this much of the recent past."""

_STATUS = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
)
_FIELDS = {
    0x6040: "controlword",
    0x6041: "statusword",
    0x6060: "mode",
    0x6064: "position",
    0x6071: "torque",
    0x6077: "torque",
}


def drive_state(statusword: int) -> str:
    """State of a drive in the words of CiA 402."""
    return next((name for mask, bits, name in _STATUS if statusword & mask == bits), "unknown")


def _whole(data: bytes, start: int, bits: int, signed: bool) -> int:
    return int.from_bytes(data[start // 8 : (start + bits) // 8], "little", signed=signed)


class Decoder:
    """Every frame of the bus, by identifier, as the host sets the bus up."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._known: dict[int, tuple[str, int, Callable[[bytes], Values]]] = {}
        self._dictionary = dictionary
        host = dictionary.bus["host_node"]
        self._add(
            0x000,
            "NMT",
            2,
            lambda d: {"command": NMT_COMMANDS.get(d[0], f"0x{d[0]:02X}"), "node": d[1]},
        )
        self._add(0x080, "SYNC", 0, lambda d: {})
        self._add(0x700 + host, "HEARTBEAT host", 1, _heartbeat)
        for axis in dictionary.axes:
            self._add(0x700 + axis.node, f"HEARTBEAT {axis.name}", 1, _heartbeat)
            self._add(
                dictionary.setup["emergency_cob"] + axis.node, f"EMCY {axis.name}", 8, _emergency
            )
            self._add(0x580 + axis.node, f"SDO answer {axis.name}", 8, _sdo)
            self._add(0x600 + axis.node, f"SDO request {axis.name}", 8, _sdo)
            for pdo in dictionary.bus_pdos(axis):
                if pdo.name == "TORQUE":
                    self._add(pdo.cob, "TORQUE", pdo.bytes, self._torque)
                elif pdo.name == "WRIST":
                    self._add(pdo.cob, "WRIST", pdo.bytes, self._wrist)
                else:
                    self._add(pdo.cob, f"{pdo.name} {axis.name}", pdo.bytes, self._pdo(pdo, axis))

    def _add(self, cob: int, name: str, length: int, values: Callable[[bytes], Values]) -> None:
        self._known[cob] = (name, length, values)

    def _torque(self, data: bytes) -> Values:
        return {
            f"{axis.name} {axis.torque_unit}": _whole(data, 16 * i, 16, True) * axis.rated * 1e-3
            for i, axis in enumerate(self._dictionary.axes)
        }

    def _wrist(self, data: bytes) -> Values:
        wrist = self._dictionary.wrist
        return {
            f"{name} deg": _whole(data, 16 * i, 16, True) * wrist["step_deg"]
            for i, name in enumerate(wrist["angles"])
        }

    def _pdo(self, pdo: Pdo, axis: Axis) -> Callable[[bytes], Values]:
        def values(data: bytes) -> Values:
            found: Values = {}
            start = 0
            for index, sub, bits in pdo.map:
                raw = _whole(data, start, bits, self._dictionary.entry(index, sub).data.signed)
                start += bits
                if index == 0x6064:
                    found[f"position {axis.position_unit}"] = raw * axis.position_step
                elif index in (0x6071, 0x6077):
                    found[f"torque {axis.torque_unit}"] = raw * axis.rated * 1e-3
                else:
                    found[_FIELDS[index]] = raw
                if index == 0x6041:
                    found["state"] = drive_state(raw)
            return found

        return values

    def decode(self, cob: int, data: bytes) -> tuple[str, Values | None]:
        """Name and values; values None when the length is not the frame's; name "unknown" for nobody's identifier."""
        if cob not in self._known:
            return "unknown", None
        name, length, values = self._known[cob]
        return name, values(data) if len(data) == length else None


def _heartbeat(data: bytes) -> Values:
    return {"state": NMT_STATES.get(data[0], f"0x{data[0]:02X}")}


def _emergency(data: bytes) -> Values:
    return {"error": f"0x{int.from_bytes(data[:2], 'little'):04X}", "register": f"0x{data[2]:02X}"}


def _sdo(data: bytes) -> Values:
    index, sub = int.from_bytes(data[1:3], "little"), data[3]
    value = int.from_bytes(data[4:], "little")
    word = (
        "abort"
        if data[0] == 0x80
        else {0x20: "write", 0x40: "read", 0x60: "written"}.get(data[0] & 0xE0, "?")
    )
    return {"object": f"{index:04X}:{sub}", "what": word, "value": f"0x{value:X}"}


@dataclass
class Row:
    """One identifier."""

    cob: int
    name: str
    count: int = 0
    malformed: int = 0
    values: Values = field(default_factory=dict)
    times_s: deque[float] = field(default_factory=deque)

    def rate_Hz(self, now_s: float) -> float:
        """Frames a second over the window that ends now."""
        while self.times_s and self.times_s[0] <= now_s - WINDOW_S:
            self.times_s.popleft()
        return len(self.times_s) / WINDOW_S


class Monitor:
    """Counts and decodes; every number is about the frames that were fed. Time: stamps of the messages, s."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._decoder = Decoder(dictionary)
        self._bitrate = dictionary.bus["bitrate_bit_s"]
        self._answers = [
            pdo.cob
            for axis in dictionary.axes
            for pdo in dictionary.bus_pdos(axis)
            if pdo.name == "STATE"
        ]
        self._answered: dict[int, int] = {}
        self.rows: dict[int, Row] = {}
        self.errors = 0
        self.drops: int | None = None
        """Frames that the kernel lost before they could be fed; None where nobody tells."""
        self.now_s = 0.0
        self.missed: dict[int, int] = {}
        """Answers that did not come before the next SYNC, by identifier, since that axis first answered."""

    def feed(self, message: can.Message) -> None:
        """One frame."""
        self.now_s = max(self.now_s, message.timestamp)
        if message.is_error_frame:
            self.errors += 1
            return
        cob, data = message.arbitration_id, bytes(message.data)
        name, values = self._decoder.decode(cob, data)
        row = self.rows.setdefault(cob, Row(cob, name))
        row.count += 1
        row.times_s.append(message.timestamp)
        row.rate_Hz(self.now_s)
        if values is not None:
            row.values = values
        elif name != "unknown":
            row.malformed += 1
        if cob == 0x080:
            for answer, count in self._answered.items():
                self.missed[answer] = self.missed.get(answer, 0) + (count == 0)
                self._answered[answer] = 0
        elif cob in self._answers:
            self._answered[cob] = self._answered.get(cob, 0) + 1

    def load(self) -> float:
        """Share of the bus time used, worst stuffing, over the last window: 0..1."""
        bits = sum(row.rate_Hz(self.now_s) * frame_bits(_length(row)) for row in self.rows.values())
        return bits / self._bitrate

    def lines(self) -> list[str]:
        """The table for a person."""
        head = f"{'COB-ID':6s}  {'frame':16s} {'count':>9s} {'Hz':>7s}  values"
        lines = [head]
        for cob, row in sorted(self.rows.items()):
            rate = row.rate_Hz(self.now_s)
            text = "  ".join(_show(name, value) for name, value in row.values.items())
            text += f"  ({row.malformed} of wrong length)" if row.malformed else ""
            lines.append(
                f"0x{cob:03X}   {row.name:16s} {row.count:9,d} {rate:7.0f}  {text}".rstrip()
            )
        missed = sum(self.missed.values())
        lost = "" if self.drops is None else f", {self.drops:,} frames lost by the kernel"
        lines.append(
            f"load {100 * self.load():.1f} %, {missed:,} answers missed, {self.errors:,} error frames{lost}"
        )
        return lines

    def report(self) -> dict[str, object]:
        """The table for a program."""
        return {
            "frames": {
                f"0x{cob:03X}": {
                    "name": row.name,
                    "count": row.count,
                    "rate_Hz": row.rate_Hz(self.now_s),
                    "malformed": row.malformed,
                    "values": row.values,
                }
                for cob, row in sorted(self.rows.items())
            },
            "load": self.load(),
            "missed": sum(self.missed.values()),
            "error_frames": self.errors,
            "kernel_drops": self.drops,
        }


_BYTES: Mapping[str, int] = {
    "SYNC": 0,
    "NMT": 2,
    "TORQUE": 6,
    "WRIST": 6,
    "CONTROL": 3,
    "HEARTBEAT": 1,
}


def _length(row: Row) -> int:
    return _BYTES.get(row.name.split()[0], 8)


def _show(name: str, value: float | int | str) -> str:
    """`position m`: 0.0409 as `position 0.0409 m`."""
    if name.endswith("word"):
        return f"{name} 0x{value:04X}"
    if not isinstance(value, float):
        return f"{name} {value}"
    what, _, unit = name.rpartition(" ")
    return f"{what} {value:.4g} {unit}"
