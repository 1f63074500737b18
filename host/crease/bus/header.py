"""The C table of the simulated drives, and the tables of firmware/servo/SPEC.md."""

from __future__ import annotations

from crease.bus.dictionary import Axis, Dictionary, Entry, Pdo

_ACCESS = {
    "const": "CR_OD_READ", "ro": "CR_OD_READ", "wo": "CR_OD_WRITE", "rw": "CR_OD_READ | CR_OD_WRITE",
}  # fmt: skip


def _flags(entry: Entry) -> str:
    flags = _ACCESS[entry.access]
    flags += " | CR_OD_RPDO" if entry.rpdo else ""
    flags += " | CR_OD_TPDO" if entry.tpdo else ""
    return flags + (" | CR_OD_SIGNED" if entry.data.signed else "")


def to_c_header(dictionary: Dictionary) -> str:
    """The text of sim/dictionary.h: a sorted table of entries with values per axis."""
    axes = dictionary.axes
    lines = [
        "/* Object dictionary of the simulated drives, from dictionary.toml by `python -m crease.bus.generate`. */",
        "#ifndef CR_SIM_DICTIONARY_H",
        "#define CR_SIM_DICTIONARY_H",
        "",
        '#include "canopen.h"',
        "",
        f"#define CR_OD_HOST_NODE 0x{dictionary.bus['host_node']:02x}u",
        "",
        "/* Node-ID, size of one position count (m or rad) and rated torque (N or N m) of each axis. */",
        f"static const uint8_t cr_od_nodes[CR_SIM_AXES] = {{{', '.join(f'0x{a.node:02x}' for a in axes)}}};",
        f"static const double cr_od_steps[CR_SIM_AXES] = {{{', '.join(repr(a.position_step) for a in axes)}}};",
        f"static const double cr_od_rated[CR_SIM_AXES] = {{{', '.join(repr(a.rated) for a in axes)}}};",
        "/* The axis whose drive reads the wrist. */",
        f"#define CR_OD_WRIST_AXIS {dictionary.wrist_axis}u",
        "",
        "/* index, sub-index, bits, flags, {value at power-on per axis}, least and greatest value for SDO. */",
        "static const cr_od_entry cr_od_entries[CR_OD_ENTRIES] = {",
    ]
    for entry in dictionary.entries:
        values = ", ".join(_c_value(dictionary, entry, axis) for axis in axes)
        low = min(dictionary.resolve(entry.low, axis) for axis in axes)
        high = max(dictionary.resolve(entry.high, axis) for axis in axes)
        lines.append(
            f"    {{0x{entry.index:04x}, {entry.sub}, {entry.data.bits}, {_flags(entry)}, "
            f"{{{values}}}, {low}, {high}}},"
        )
    lines += ["};", "", "#endif", ""]
    return "\n".join(lines)


def _c_value(dictionary: Dictionary, entry: Entry, axis: Axis) -> str:
    value = dictionary.resolve(entry.value, axis)
    return f"0x{value & 0xFFFF_FFFF:x}u"


def count_line(dictionary: Dictionary) -> str:
    """The capacity that sim/canopen.h has to name."""
    return f"#define CR_OD_ENTRIES {len(dictionary.entries)}"


def _default(entry: Entry) -> str:
    if isinstance(entry.value, str):
        return entry.value
    return f"0x{entry.value:X}" if entry.data.bits == 32 else str(entry.value)


def _frame_name(pdo: Pdo, axis: Axis) -> str:
    return pdo.name if pdo.name in ("TORQUE", "WRIST") else f"{pdo.name} {axis.name}"


def to_markdown(dictionary: Dictionary) -> str:
    """The tables of frames, axes and objects as Markdown."""
    rows = [
        "#### Frames of the bus as the host sets it up",
        "",
        "| COB-ID | name | bytes | carries |",
        "|---|---|---|---|",
    ]
    seen: set[int] = set()
    for axis in dictionary.axes:
        for pdo in dictionary.bus_pdos(axis):
            if pdo.cob in seen:
                continue
            seen.add(pdo.cob)
            if pdo.name == "TORQUE":
                what = ", ".join(f"0x6071 of {a.name}" for a in dictionary.axes)
            else:
                what = ", ".join(
                    f"0x{index:04X}" + (f":{sub}" if sub else "") for index, sub, _ in pdo.map
                )
            rows.append(f"| 0x{pdo.cob:03X} | {_frame_name(pdo, axis)} | {pdo.bytes} | {what} |")
    rows += [
        "",
        "#### Axes",
        "",
        "| axis | node | joint | one count of 0x6064 | rated torque 0x6076 | 0x6072 |",
        "|---|---|---|---|---|---|",
    ]
    rows += [
        f"| {a.name} | 0x{a.node:02X} | {a.description} | {a.position_step:.6g} {a.position_unit} "
        f"| {a.rated:g} {a.torque_unit} | {a.max_permille} |"
        for a in dictionary.axes
    ]
    rows += [
        "",
        "#### Objects of a drive at power-on",
        "",
        "| object | name | type | access | PDO | value |",
        "|---|---|---|---|---|---|",
    ]
    for entry in dictionary.entries:
        name = entry.object_name if entry.kind == "var" else f"{entry.object_name}: {entry.name}"
        mappable = " ".join(word for word, yes in (("R", entry.rpdo), ("T", entry.tpdo)) if yes)
        rows.append(
            f"| {entry.index:04X}:{entry.sub} | {name} | {entry.type} | {entry.access} | {mappable} "
            f"| {_default(entry)} |"
        )
    return "\n".join([*rows, ""])
