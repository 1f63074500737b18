"""EDS of a drive (CiA 306), for any CANopen tool: the dictionary handed to the exporter of canopen.

That one writes the time of day unless it is given another; types that may be skipped are objects Dummy000N to it.
"""

from __future__ import annotations

import io
from itertools import groupby
from typing import TYPE_CHECKING, Any

from crease.bus.dictionary import DUMMIES, Axis, Dictionary, Entry

if TYPE_CHECKING:
    from collections.abc import Sequence

_FILE_INFO = {
    "FileVersion": "1",
    "FileRevision": "0",
    "EDSVersion": "4.0",
    "CreationTime": "12:00AM",
    "CreationDate": "01-01-2025",
    "CreatedBy": "crease",
    "ModificationTime": "12:00AM",
    "ModificationDate": "01-01-2025",
    "ModifiedBy": "crease",
}
"""The same bytes from the same dictionary."""


def _value(dictionary: Dictionary, entry: Entry, axis: Axis) -> str:
    """Default value; relative to the node where it is so in the dictionary."""
    if isinstance(entry.value, str) and entry.value.startswith("$NODEID"):
        return entry.value
    value = dictionary.resolve(entry.value, axis)
    return f"0x{value:0{entry.data.bits // 4}X}" if value >= 0 else str(value)


def _variable(dictionary: Dictionary, entry: Entry, axis: Axis) -> Any:
    from canopen.objectdictionary import ODVariable

    name = entry.object_name if entry.kind == "var" else entry.name
    made = ODVariable(name, entry.index, entry.sub)
    made.data_type, made.access_type = entry.data.code, entry.access
    made.default_raw = _value(dictionary, entry, axis)
    made.pdo_mappable = entry.rpdo or entry.tpdo
    low, high = (dictionary.resolve(limit, axis) for limit in (entry.low, entry.high))
    if (low, high) != (entry.data.low, entry.data.high) and entry.access == "rw":
        made.min, made.max = low, high
    return made


def _object(dictionary: Dictionary, entries: Sequence[Entry], axis: Axis) -> Any:
    from canopen.objectdictionary import ODArray, ODRecord

    first = entries[0]
    if first.kind == "var":
        return _variable(dictionary, first, axis)
    made = (ODArray if first.kind == "array" else ODRecord)(first.object_name, first.index)
    for entry in entries:
        made.add_member(_variable(dictionary, entry, axis))
    return made


def _describe(information: Any, dictionary: Dictionary, axis: Axis) -> None:
    """The [DeviceInfo] of the file."""
    bus, pdos = dictionary.bus, dictionary.drive_pdos(axis)
    information.vendor_name, information.vendor_number = "crease", bus["vendor_id"]
    information.product_name, information.product_number = f"axis {axis.name}", bus["product_code"]
    information.revision_number, information.order_code = bus["revision"], f"crease-{axis.name}"
    information.allowed_baudrates = {bus["bitrate_bit_s"]}
    information.simple_boot_up_master, information.simple_boot_up_slave = False, True
    information.granularity = 8
    information.dynamic_channels_supported = information.group_messaging = False
    information.nr_of_RXPDO = sum(pdo.kind == "rpdo" for pdo in pdos)
    information.nr_of_TXPDO = sum(pdo.kind == "tpdo" for pdo in pdos)
    information.LSS_supported = False


def to_eds(dictionary: Dictionary, axis: Axis) -> str:
    """The text of the EDS of one axis: the drive as it is at power-on."""
    from canopen.objectdictionary import ObjectDictionary, ODVariable
    from canopen.objectdictionary.eds import export_eds

    od = ObjectDictionary()
    _describe(od.device_information, dictionary, axis)
    od.comments = "generated from dictionary.toml of crease"
    for index in sorted(DUMMIES):
        od.add_object(ODVariable(f"Dummy{index:04d}", index))
    for _, entries in groupby(dictionary.entries, key=lambda entry: entry.index):
        od.add_object(_object(dictionary, list(entries), axis))
    file_info = {
        "FileName": f"crease_{axis.name.lower()}.eds",
        "Description": f"CiA 402 drive of {axis.description}",
        **_FILE_INFO,
    }
    setattr(od, "__edsFileInfo", {})  # else a second EDSVersion comes in, spelled otherwise
    text = io.StringIO()
    export_eds(od, text, file_info)
    return text.getvalue()
