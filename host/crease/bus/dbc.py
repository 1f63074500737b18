"""DBC of the bus as the host sets it up, for cantools, SavvyCAN and the like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cantools.database import Database
from cantools.database.can import Message, Node, Signal
from cantools.database.conversion import BaseConversion

from crease.bus.dictionary import Axis, Dictionary, Pdo

_HOST = "HOST"
_NAMES = {
    0x6064: "position",
    0x6077: "torque",
    0x6041: "statusword",
    0x6040: "controlword",
    0x6060: "mode",
    0x6071: "torque_target",
}
_STATES = {
    0x00: "not ready to switch on", 0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational",
}  # fmt: skip
_COMMANDS = {
    0x01: "start",
    0x02: "stop",
    0x80: "enter pre-operational",
    0x81: "reset node",
    0x82: "reset communication",
}
_SDO_REQUESTS = {
    0x22: "write", 0x23: "write 4", 0x27: "write 3", 0x2B: "write 2", 0x2F: "write 1", 0x40: "read",
    0x80: "abort",
}  # fmt: skip
_SDO_RESPONSES = {
    0x42: "value", 0x43: "value 4", 0x47: "value 3", 0x4B: "value 2", 0x4F: "value 1",
    0x60: "written", 0x80: "abort",
}  # fmt: skip


def _signal(
    name: str, start: int, bits: int, to: str, signed: bool = False,
    scale: tuple[float, str] = (1, ""), choices: Mapping[int, str] | None = None,
) -> Signal:  # fmt: skip
    """A number, low byte first. to: who receives it. scale: physical value of one count, and its unit."""
    factor, unit = scale
    named: Any = dict(choices) if choices else None
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    return Signal(
        name, start, bits, byte_order="little_endian", is_signed=signed, unit=unit,
        conversion=BaseConversion.factory(scale=factor, offset=0, choices=named),
        minimum=low * factor, maximum=high * factor, receivers=to.split(","),
    )  # fmt: skip


def _scaling(dictionary: Dictionary, index: int, axis: Axis) -> tuple[float, str]:
    """Physical value of one count, and its unit."""
    if index == 0x2100:
        return float(dictionary.wrist["step_deg"]), "deg"
    if index == 0x6064:
        return axis.position_step, axis.position_unit
    if index in (0x6071, 0x6077):
        return axis.rated * 1e-3, axis.torque_unit
    return 1, ""


def _message(
    cob: int, name: str, length: int, sender: str, signals: Sequence[Signal] = ()
) -> Message:
    return Message(cob, name, length, list(signals), senders=[sender])


def _pdo_signals(dictionary: Dictionary, pdo: Pdo, axis: Axis, receiver: str) -> list[Signal]:
    signals, start = [], 0
    for index, sub, bits in pdo.map:
        signed = dictionary.entry(index, sub).data.signed
        name = dictionary.wrist["angles"][sub - 1] if index == 0x2100 else _NAMES[index]
        scale = _scaling(dictionary, index, axis)
        signals.append(_signal(name, start, bits, receiver, signed, scale))
        start += bits
    return signals


def _torque(dictionary: Dictionary, pdo: Pdo) -> Message:
    """One word per axis in the frame that all drives share."""
    signals = [
        _signal(f"torque_{axis.name}", 16 * i, 16, _drive(axis), True, _scaling(dictionary, 0x6071, axis))
        for i, axis in enumerate(dictionary.axes)
    ]  # fmt: skip
    return _message(pdo.cob, pdo.name, pdo.bytes, _HOST, signals)


def _sdo(receiver: str, commands: Mapping[int, str]) -> list[Signal]:
    """An expedited SDO frame (CiA 301, 7.2.4.3): value, or abort code, in the last four bytes."""
    return [
        _signal("command", 0, 8, receiver, choices=commands),
        _signal("index", 8, 16, receiver),
        _signal("subindex", 24, 8, receiver),
        _signal("value", 32, 32, receiver),
    ]


def _drive(axis: Axis) -> str:
    return f"DRIVE_{axis.name}"


def _heartbeat(node: int, name: str, sender: str, receiver: str) -> Message:
    state = _signal("state", 0, 8, receiver, choices=_STATES)
    return _message(0x700 + node, f"HEARTBEAT_{name}", 1, sender, [state])


def _of_axis(dictionary: Dictionary, axis: Axis) -> list[Message]:
    """What a drive alone says or hears."""
    drive, messages = _drive(axis), []
    for pdo in dictionary.bus_pdos(axis):
        if pdo.name == "TORQUE":
            continue
        sender, receiver = (_HOST, drive) if pdo.kind == "rpdo" else (drive, _HOST)
        name = pdo.name if pdo.name == "WRIST" else f"{pdo.name}_{axis.name}"
        signals = _pdo_signals(dictionary, pdo, axis, receiver)
        messages.append(_message(pdo.cob, name, pdo.bytes, sender, signals))
    emergency = [
        _signal("error_code", 0, 16, _HOST),
        _signal("error_register", 16, 8, _HOST),
        _signal("detail", 24, 32, _HOST),
    ]
    cob, node = dictionary.setup["emergency_cob"] + axis.node, axis.node
    return [
        *messages,
        _message(cob, f"EMCY_{axis.name}", 8, drive, emergency),
        _heartbeat(node, axis.name, drive, _HOST),
        _message(0x600 + node, f"SDO_REQUEST_{axis.name}", 8, _HOST, _sdo(drive, _SDO_REQUESTS)),
        _message(0x580 + node, f"SDO_RESPONSE_{axis.name}", 8, drive, _sdo(_HOST, _SDO_RESPONSES)),
    ]


def to_dbc(dictionary: Dictionary) -> str:
    """The text of the DBC: SYNC, NMT, torque, state, control, SDO, emergency and heartbeat of every node."""
    axes = dictionary.axes
    anyone = ",".join(_drive(axis) for axis in axes)
    nmt = [_signal("command", 0, 8, anyone, choices=_COMMANDS), _signal("node", 8, 8, anyone)]
    torque = next(pdo for pdo in dictionary.bus_pdos(axes[0]) if pdo.name == "TORQUE")
    messages = [
        _message(0x000, "NMT", 2, _HOST, nmt),
        _message(int(dictionary.entry(0x1005, 0).value), "SYNC", 0, _HOST),
        _heartbeat(dictionary.bus["host_node"], "HOST", _HOST, anyone),
        _torque(dictionary, torque),
        *(message for axis in axes for message in _of_axis(dictionary, axis)),
    ]
    nodes = [Node(_HOST, None), *(Node(_drive(axis), None) for axis in axes)]
    return str(Database(messages, nodes, version="crease").as_dbc_string())
