"""EDS of a drive (CiA 306), for any CANopen tool.

Written here: the one of canopen puts the time of day in, leaves the numbers of PDOs out, and changes the granularity.
"""

from __future__ import annotations

from itertools import groupby

from crease.bus.dictionary import DUMMIES, Axis, Dictionary, Entry

_MANDATORY = (0x1000, 0x1001, 0x1018)
_OBJECT_CODE = {"var": 0x7, "array": 0x8, "record": 0x9}


def _number(value: int, bits: int) -> str:
    return f"0x{value & ((1 << bits) - 1):0{bits // 4}X}" if value >= 0 else str(value)


def _value(dictionary: Dictionary, entry: Entry, axis: Axis) -> str:
    """Default value; relative to the node where it is so in the dictionary."""
    if isinstance(entry.value, str) and entry.value.startswith("$NODEID"):
        return entry.value
    return _number(dictionary.resolve(entry.value, axis), entry.data.bits)


def _entry_lines(dictionary: Dictionary, entry: Entry, axis: Axis) -> list[str]:
    lines = [
        f"ParameterName={entry.object_name if entry.kind == 'var' else entry.name}",
        "ObjectType=0x7",
        f"DataType=0x{entry.data.code:04X}",
        f"AccessType={entry.access}",
        f"DefaultValue={_value(dictionary, entry, axis)}",
        f"PDOMapping={int(entry.rpdo or entry.tpdo)}",
    ]
    low, high = (dictionary.resolve(limit, axis) for limit in (entry.low, entry.high))
    if (low, high) != (entry.data.low, entry.data.high) and entry.access == "rw":
        lines += [
            f"LowLimit={_number(low, entry.data.bits)}",
            f"HighLimit={_number(high, entry.data.bits)}",
        ]
    return lines


def _list_section(name: str, indices: list[int]) -> list[str]:
    lines = [f"[{name}]", f"SupportedObjects={len(indices)}"]
    return [*lines, *(f"{i}=0x{index:04X}" for i, index in enumerate(indices, 1)), ""]


def to_eds(dictionary: Dictionary, axis: Axis) -> str:
    """The text of the EDS of one axis: the drive as it is at power-on."""
    bus = dictionary.bus
    rpdos = sum(pdo.kind == "rpdo" for pdo in dictionary.drive_pdos(axis))
    tpdos = sum(pdo.kind == "tpdo" for pdo in dictionary.drive_pdos(axis))
    rates = (10, 20, 50, 125, 250, 500, 800, 1000)
    supported = bus["bitrate_bit_s"] // 1000
    lines = [
        "[FileInfo]", f"FileName=crease_{axis.name.lower()}.eds", "FileVersion=1", "FileRevision=0",
        "EDSVersion=4.0", f"Description=CiA 402 drive of {axis.description}", "CreationTime=12:00AM",
        "CreationDate=01-01-2025", "CreatedBy=crease", "ModificationTime=12:00AM",
        "ModificationDate=01-01-2025", "ModifiedBy=crease", "",
        "[DeviceInfo]", "VendorName=crease", f"VendorNumber=0x{bus['vendor_id']:08X}",
        f"ProductName=axis {axis.name}", f"ProductNumber=0x{bus['product_code']:08X}",
        f"RevisionNumber=0x{bus['revision']:08X}", f"OrderCode=crease-{axis.name}",
        *(f"BaudRate_{rate}={int(rate == supported)}" for rate in rates),
        "SimpleBootUpMaster=0", "SimpleBootUpSlave=1", "Granularity=8", "DynamicChannelsSupported=0",
        "GroupMessaging=0", f"NrOfRxPDO={rpdos}", f"NrOfTxPDO={tpdos}", "LSS_Supported=0", "",
        "[DummyUsage]", *(f"Dummy{i:04X}={int(i in DUMMIES)}" for i in range(1, 8)), "",
        "[Comments]", "Lines=1", "Line1=generated from dictionary.toml of crease", "",
    ]  # fmt: skip
    indices = sorted({entry.index for entry in dictionary.entries})
    lines += _list_section("MandatoryObjects", [i for i in indices if i in _MANDATORY])
    lines += _list_section(
        "OptionalObjects", [i for i in indices if i not in _MANDATORY and not 0x2000 <= i < 0x6000]
    )
    lines += _list_section("ManufacturerObjects", [i for i in indices if 0x2000 <= i < 0x6000])
    for index, group in groupby(dictionary.entries, key=lambda entry: entry.index):
        entries = list(group)
        first = entries[0]
        if first.kind == "var":
            lines += [f"[{index:04X}]", *_entry_lines(dictionary, first, axis), ""]
            continue
        lines += [
            f"[{index:04X}]",
            f"ParameterName={first.object_name}",
            f"ObjectType=0x{_OBJECT_CODE[first.kind]:X}",
            f"SubNumber={len(entries)}",
            "",
        ]
        for entry in entries:
            lines += [f"[{index:04X}sub{entry.sub:X}]", *_entry_lines(dictionary, entry, axis), ""]
    return "\n".join(lines)
