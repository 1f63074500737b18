"""The object dictionary of the drives and the layout of the bus, from dictionary.toml."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from crease.base.errors import BusError

SOURCE = Path(__file__).with_name("dictionary.toml")

PDO_INVALID = 0x8000_0000
PDO_NO_RTR = 0x4000_0000
PDO_ENTRIES_MAX = 8
DUMMIES = {5: 8, 6: 16, 7: 32, 2: 8, 3: 16, 4: 32}
"""Indices of CiA 301 data types that an RPDO may map to skip bits, with their length in bits."""


@dataclass(frozen=True)
class DataType:
    """A CiA 301 basic type."""

    code: int
    bits: int
    signed: bool

    @property
    def low(self) -> int:
        """Least value."""
        return -(1 << (self.bits - 1)) if self.signed else 0

    @property
    def high(self) -> int:
        """Greatest value."""
        return (1 << (self.bits - self.signed)) - 1


TYPES = {
    "INTEGER8": DataType(2, 8, True),
    "INTEGER16": DataType(3, 16, True),
    "INTEGER32": DataType(4, 32, True),
    "UNSIGNED8": DataType(5, 8, False),
    "UNSIGNED16": DataType(6, 16, False),
    "UNSIGNED32": DataType(7, 32, False),
}


@dataclass(frozen=True)
class Axis:
    """One drive. Units: position_step in m or rad per count, rated in N or N m, max_permille of rated."""

    name: str
    node: int
    description: str
    position_unit: str
    position_step: float
    torque_unit: str
    rated: float
    max_permille: int


@dataclass(frozen=True)
class Entry:
    """One index and sub-index of a drive. `value`, `low`, `high` may hold $NODEID and the like: see `resolve`."""

    index: int
    sub: int
    name: str
    type: str
    access: str
    value: int | str
    low: int | str
    high: int | str
    rpdo: bool
    tpdo: bool
    kind: str
    object_name: str

    @property
    def data(self) -> DataType:
        """Its CiA 301 type."""
        return TYPES[self.type]


@dataclass(frozen=True)
class Pdo:
    """One PDO of a drive: identifier, transmission type, and what it carries as (index, sub, bits)."""

    name: str
    kind: str
    number: int
    cob: int
    type: int
    map: tuple[tuple[int, int, int], ...]

    @property
    def bytes(self) -> int:
        """Length of the frame."""
        return sum(bits for _, _, bits in self.map) // 8


@dataclass(frozen=True)
class Message:
    """One frame of the timing model. Units: us. rendering: comes while torque flows. sender: host or drive."""

    name: str
    cob: int
    bytes: int
    period_us: int
    jitter_us: int
    cyclic: bool
    rendering: bool = True
    sender: str = "drive"


@dataclass(frozen=True)
class Dictionary:
    """Everything that dictionary.toml says."""

    bus: Mapping[str, int]
    setup: Mapping[str, int]
    wrist: Mapping[str, Any]
    schedule: Mapping[str, int]
    axes: tuple[Axis, ...]
    entries: tuple[Entry, ...]
    raw: Mapping[str, Any]

    def entry(self, index: int, sub: int) -> Entry:
        """Errors: BusError when there is none."""
        for entry in self.entries:
            if (entry.index, entry.sub) == (index, sub):
                return entry
        raise BusError(f"{SOURCE.name}: no object {index:04X}:{sub}")

    def resolve(self, value: int | str, axis: Axis) -> int:
        """A value as a number for one axis: $NODEID, $RATED, $MAX and so on filled in.

        Errors: BusError for a name that is not known.
        """
        if isinstance(value, int):
            return value
        names = {
            "$NODEID": axis.node,
            "$RATED": round(axis.rated * 1000),
            "$MAX": axis.max_permille,
            "$VENDOR": self.bus["vendor_id"],
            "$PRODUCT": self.bus["product_code"],
            "$REVISION": self.bus["revision"],
        }
        match = re.fullmatch(r"(\$[A-Z]+)(?:\+(0x[0-9A-Fa-f]+|\d+))?", value)
        if match is None or match[1] not in names:
            raise BusError(f"{SOURCE.name}: value '{value}' is not known; use {', '.join(names)}")
        return names[match[1]] + int(match[2] or "0", 0)

    def bus_pdos(self, axis: Axis) -> tuple[Pdo, ...]:
        """The PDOs of one drive as the host sets them up."""
        items = self.raw["bus_pdo"]
        return tuple(self._pdo(i, axis) for i in items if i.get("axis", axis.name) == axis.name)

    @property
    def wrist_axis(self) -> int:
        """Number of the axis whose drive reads the wrist."""
        name = next(item["axis"] for item in self.raw["bus_pdo"] if item["name"] == "WRIST")
        return [axis.name for axis in self.axes].index(name)

    def drive_pdos(self, axis: Axis) -> tuple[Pdo, ...]:
        """The PDOs of one drive at power-on."""
        return tuple(self._pdo(item, axis) for item in self.raw["drive_pdo"])

    def _pdo(self, item: Mapping[str, Any], axis: Axis) -> Pdo:
        if "shared" in item:
            index, sub, bits = self._mapped(item["shared"])
            dummy = (TYPES[self.entry(index, sub).type].code, 0, bits)
            mapped = tuple((index, sub, bits) if other is axis else dummy for other in self.axes)
        else:
            mapped = tuple(self._mapped(text) for text in item["map"])
        cob = self.resolve(item["cob"], axis)
        return Pdo(item.get("name", ""), item["kind"], item["number"], cob, item["type"], mapped)

    def _mapped(self, text: str) -> tuple[int, int, int]:
        index, sub = (int(part, 16) for part in text.split(":"))
        return index, sub, self.entry(index, sub).data.bits

    def messages(self) -> tuple[Message, ...]:
        """The frames of the timing model, highest priority first."""
        found: list[Message] = []
        for item in self.raw["message"]:
            jitter = self.schedule[f"{item['sender']}_jitter_us"]
            rest = (
                item["bytes"], item["period_us"], jitter, bool(item.get("cyclic", False)),
                bool(item.get("rendering", True)), item["sender"],
            )  # fmt: skip
            if item.get("per_axis"):
                found += [
                    Message(f"{item['name']}_{axis.name}", item["cob"] + axis.node, *rest)
                    for axis in self.axes
                ]
            else:
                found.append(Message(item["name"], item["cob"], *rest))
        return tuple(sorted(found, key=lambda message: message.cob))


def _entries_of(item: Mapping[str, Any]) -> list[Entry]:
    """The entries of one [[object]] table."""
    kind = item.get("kind", "var")
    if kind == "var":
        return [_entry(item, item, 0, kind)]
    count = {
        "name": "Highest sub-index supported" if kind == "record" else "Number of entries",
        "type": "UNSIGNED8",
        "access": item.get("count_access", "const"),
        "value": item.get("count_value", max(sub["sub"] for sub in item["sub"])),
    }
    if "count_high" in item:
        count["high"] = item["count_high"]
    return [_entry(item, count, 0, kind)] + [
        _entry(item, sub, sub["sub"], kind) for sub in item["sub"]
    ]


def _entry(item: Mapping[str, Any], own: Mapping[str, Any], sub: int, kind: str) -> Entry:
    data = TYPES[own["type"]]
    pdo = own.get("pdo", "")
    return Entry(
        index=item["index"],
        sub=sub,
        name=own["name"],
        type=own["type"],
        access=own["access"],
        value=own.get("value", 0),
        low=own.get("low", data.low),
        high=own.get("high", data.high),
        rpdo="r" in pdo,
        tpdo="t" in pdo,
        kind=kind,
        object_name=item["name"],
    )


def _pdo_objects(item: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Communication and mapping parameter of one [[drive_pdo]], as [[object]] tables."""
    receive = item["kind"] == "rpdo"
    number, name = item["number"], f"{item['kind'].upper()} {item['number']}"
    comm: list[dict[str, Any]] = [
        {"sub": 1, "name": "COB-ID", "type": "UNSIGNED32", "access": "rw", "value": item["cob"]},
        {
            "sub": 2,
            "name": "Transmission type",
            "type": "UNSIGNED8",
            "access": "rw",
            "value": item["type"],
        },
        {"sub": 3, "name": "Inhibit time, 100 us", "type": "UNSIGNED16", "access": "rw"},
        {"sub": 5, "name": "Event timer, ms", "type": "UNSIGNED16", "access": "rw"},
    ]
    mapped = [int(text.split(":")[0], 16) for text in item["map"]]
    entries: list[dict[str, Any]] = [
        {"sub": i + 1, "name": f"Entry {i + 1}", "type": "UNSIGNED32", "access": "rw"}
        for i in range(PDO_ENTRIES_MAX)
    ]
    for entry, index in zip(entries, mapped, strict=False):
        entry["value"] = f"MAP{index:04X}"
    return [
        {
            "index": (0x1400 if receive else 0x1800) + number - 1,
            "name": f"{name} communication parameter",
            "kind": "record",
            "sub": comm,
        },
        {
            "index": (0x1600 if receive else 0x1A00) + number - 1,
            "name": f"{name} mapping parameter",
            "kind": "record",
            "count_access": "rw",
            "count_value": len(mapped),
            "count_high": PDO_ENTRIES_MAX,
            "sub": entries,
        },
    ]


@cache
def load(path: Path = SOURCE) -> Dictionary:
    """Read the source.   Errors: BusError when it is not well formed."""
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        objects = list(raw["object"])
        for pdo in raw["drive_pdo"]:
            objects += _pdo_objects(pdo)
        entries = [e for item in objects for e in _entries_of(item)]
        bits = {e.index: e.data.bits for e in entries if e.sub == 0}
        entries = [_with_map_value(entry, bits) for entry in entries]
        return Dictionary(
            bus=raw["bus"],
            setup=raw["setup"],
            wrist=raw["wrist"],
            schedule=raw["schedule"],
            axes=tuple(Axis(**item) for item in raw["axis"]),
            entries=tuple(sorted(entries, key=lambda entry: (entry.index, entry.sub))),
            raw=raw,
        )
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise BusError(f"{path}: cannot be read as a dictionary: {error}") from error


def _with_map_value(entry: Entry, bits: Mapping[int, int]) -> Entry:
    """`MAP6041` of a mapping entry becomes its number: index, sub-index, bits."""
    if not isinstance(entry.value, str) or not entry.value.startswith("MAP"):
        return entry
    index = int(entry.value[3:], 16)
    return Entry(**{**entry.__dict__, "value": index << 16 | bits[index]})
