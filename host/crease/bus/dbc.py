"""DBC of the bus as the host sets it up, for cantools, SavvyCAN and the like."""

from __future__ import annotations

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
    name: str, start: int, bits: int, signed: bool, factor: float, unit: str, receiver: str
) -> str:
    sign = "-" if signed else "+"
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    limits = f"[{low * factor!r}|{high * factor!r}]"
    return f' SG_ {name} : {start}|{bits}@1{sign} ({factor!r},0) {limits} "{unit}" {receiver}'


def _scaling(dictionary: Dictionary, index: int, axis: Axis) -> tuple[float, str]:
    """Physical value of one count, and its unit."""
    if index == 0x2100:
        return float(dictionary.wrist["step_deg"]), "deg"
    if index == 0x6064:
        return axis.position_step, axis.position_unit
    if index in (0x6071, 0x6077):
        return axis.rated * 1e-3, axis.torque_unit
    return 1, ""


def _pdo_signals(dictionary: Dictionary, pdo: Pdo, axis: Axis, receiver: str) -> list[str]:
    lines, start = [], 0
    for index, sub, bits in pdo.map:
        entry = dictionary.entry(index, sub)
        factor, unit = _scaling(dictionary, index, axis)
        name = dictionary.wrist["angles"][sub - 1] if index == 0x2100 else _NAMES[index]
        lines.append(_signal(name, start, bits, entry.data.signed, factor, unit, receiver))
        start += bits
    return lines


def _torque_signals(dictionary: Dictionary) -> list[str]:
    """One word per axis in the frame that all drives share."""
    return [
        _signal(
            f"torque_{axis.name}",
            16 * i,
            16,
            True,
            *_scaling(dictionary, 0x6071, axis),
            f"DRIVE_{axis.name}",
        )
        for i, axis in enumerate(dictionary.axes)
    ]


def _sdo(receiver: str) -> list[str]:
    """An expedited SDO frame (CiA 301, 7.2.4.3): value, or abort code, in the last four bytes."""
    return [
        _signal("command", 0, 8, False, 1, "", receiver),
        _signal("index", 8, 16, False, 1, "", receiver),
        _signal("subindex", 24, 8, False, 1, "", receiver),
        _signal("value", 32, 32, False, 1, "", receiver),
    ]


def _message(cob: int, name: str, length: int, sender: str, signals: list[str]) -> list[str]:
    return [f"BO_ {cob} {name}: {length} {sender}", *signals, ""]


def to_dbc(dictionary: Dictionary) -> str:
    """The text of the DBC: SYNC, NMT, torque, state, control, SDO, emergency and heartbeat of every node."""
    axes, setup = dictionary.axes, dictionary.setup
    drives = [f"DRIVE_{axis.name}" for axis in axes]
    anyone = ",".join(drives)
    lines = [
        'VERSION "crease"',
        "",
        "NS_ :",
        "",
        "BS_:",
        "",
        f"BU_: {_HOST} {' '.join(drives)}",
        "",
    ]
    nmt = [
        _signal("command", 0, 8, False, 1, "", anyone),
        _signal("node", 8, 8, False, 1, "", anyone),
    ]
    lines += _message(0x000, "NMT", 2, _HOST, nmt)
    lines += _message(dictionary.entry(0x1005, 0).value, "SYNC", 0, _HOST, [])  # type: ignore[arg-type]
    state = [_signal("state", 0, 8, False, 1, "", _HOST)]
    lines += _message(
        0x700 + dictionary.bus["host_node"],
        "HEARTBEAT_HOST",
        1,
        _HOST,
        [state[0].replace(_HOST, anyone)],
    )
    values = [
        f"VAL_ {0x700 + dictionary.bus['host_node']} state {_value_table(_STATES)} ;",
        f"VAL_ 0 command {_value_table(_COMMANDS)} ;",
    ]
    for number, axis in enumerate(axes):
        drive = drives[number]
        for pdo in dictionary.bus_pdos(axis):
            if pdo.name == "TORQUE":
                if number == 0:
                    lines += _message(
                        pdo.cob, pdo.name, pdo.bytes, _HOST, _torque_signals(dictionary)
                    )
                continue
            sender, receiver = (_HOST, drive) if pdo.kind == "rpdo" else (drive, _HOST)
            signals = _pdo_signals(dictionary, pdo, axis, receiver)
            name = pdo.name if pdo.name == "WRIST" else f"{pdo.name}_{axis.name}"
            lines += _message(pdo.cob, name, pdo.bytes, sender, signals)
        emergency = [
            _signal("error_code", 0, 16, False, 1, "", _HOST),
            _signal("error_register", 16, 8, False, 1, "", _HOST),
            _signal("detail", 24, 32, False, 1, "", _HOST),
        ]
        lines += _message(
            setup["emergency_cob"] + axis.node, f"EMCY_{axis.name}", 8, drive, emergency
        )
        lines += _message(0x700 + axis.node, f"HEARTBEAT_{axis.name}", 1, drive, state)
        lines += _message(0x600 + axis.node, f"SDO_REQUEST_{axis.name}", 8, _HOST, _sdo(drive))
        lines += _message(0x580 + axis.node, f"SDO_RESPONSE_{axis.name}", 8, drive, _sdo(_HOST))
        values += [
            f"VAL_ {0x600 + axis.node} command {_value_table(_SDO_REQUESTS)} ;",
            f"VAL_ {0x580 + axis.node} command {_value_table(_SDO_RESPONSES)} ;",
        ]
        values.append(f"VAL_ {0x700 + axis.node} state {_value_table(_STATES)} ;")
    return "\n".join([*lines, *values, ""])


def _value_table(names: dict[int, str]) -> str:
    return " ".join(f'{value} "{name}"' for value, name in sorted(names.items(), reverse=True))
