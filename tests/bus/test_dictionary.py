"""One dictionary: what is generated from it is accepted, and read the same, by tools of others."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import canopen
import cantools
import pytest
from crease.base.native import lib
from crease.bus.dictionary import DUMMIES, load
from crease.bus.generate import committed, export
from crease.bus.header import count_line
from crease.bus.monitor import Decoder

ROOT = Path(__file__).resolve().parents[2]
AXES = ("x", "y", "z")


def load_dbc(generated: Path) -> Any:
    """The DBC as cantools has it."""
    return cantools.database.load_file(generated / "crease.dbc")


def test_exported_files_are_the_same_every_time(generated: Path, tmp_path: Path) -> None:
    for path in export(tmp_path):
        assert path.read_bytes() == (generated / path.name).read_bytes()


def test_committed_files_are_what_the_dictionary_says() -> None:
    for path, text in committed().items():
        assert path.read_text(encoding="utf-8") == text, (
            f"{path}: run python -m crease.bus.generate"
        )
    assert count_line(load()) in (ROOT / "sim" / "canopen.h").read_text(encoding="utf-8")


@pytest.mark.parametrize("axis", AXES)
def test_dcfchk_accepts_every_eds_without_a_word(generated: Path, axis: str) -> None:
    node = str(0x11 + AXES.index(axis))
    program = Path(sys.executable).with_name("dcfchk")
    said = subprocess.run(
        [program, "-n", node, generated / f"crease_{axis}.eds"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


@pytest.mark.parametrize("axis", range(3))
def test_canopen_reads_every_object_as_the_dictionary_has_it(generated: Path, axis: int) -> None:
    dictionary = load()
    one = dictionary.axes[axis]
    od = canopen.import_od(str(generated / f"crease_{AXES[axis]}.eds"), one.node)
    for entry in dictionary.entries:
        found = od[entry.index] if entry.kind == "var" else od[entry.index][entry.sub]
        assert found.data_type == entry.data.code
        assert found.access_type == entry.access
        assert found.default == dictionary.resolve(entry.value, one), (
            f"{entry.index:04X}:{entry.sub}"
        )


@pytest.mark.parametrize("axis", range(3))
def test_an_eds_says_what_the_device_is_and_nothing_of_the_day(generated: Path, axis: int) -> None:
    dictionary = load()
    file = generated / f"crease_{AXES[axis]}.eds"
    about = canopen.import_od(str(file), None).device_information
    assert (about.nr_of_RXPDO, about.nr_of_TXPDO) == (2, 2)
    assert about.allowed_baudrates == {dictionary.bus["bitrate_bit_s"]}
    assert about.product_name == f"axis {AXES[axis].upper()}"
    text = file.read_text(encoding="ascii")
    assert "\nGranularity=8\n" in text
    head = re.findall(r"^(.+?)=", text.partition("[DeviceInfo]")[0].lower(), re.MULTILINE)
    assert len(head) == len(set(head))
    assert set(re.findall(r"(?:Creation|Modification)(?:Date|Time)=(.*)", text)) == {
        "01-01-2025",
        "12:00AM",
    }
    dummies = {int(i) for i in re.findall(r"^Dummy(\d{4})=1$", text, re.MULTILINE)}
    assert dummies == set(DUMMIES)


def test_cantools_decodes_every_frame_as_the_monitor_does(generated: Path) -> None:
    database = load_dbc(generated)
    decoder = Decoder(load())
    data = bytes([0x12, 0xFF, 0x34, 0xFE, 0x56, 0x01, 0x27, 0x06])
    for cob, name in ((0x181, "TORQUE"), *((0x191 + i, f"STATE {'XYZ'[i]}") for i in range(3))):
        message = database.get_message_by_frame_id(cob)
        payload = data[: message.length]
        theirs = message.decode(payload, decode_choices=False)
        said, ours = decoder.decode(cob, payload)
        assert said == name
        assert ours is not None
        if cob == 0x181:
            pairs = [(f"torque_{a}", next(k for k in ours if k.startswith(a))) for a in "XYZ"]
        else:
            pairs = [
                (k, next(o for o in ours if o.startswith(k)))
                for k in ("position", "torque", "statusword")
            ]
        for their_key, our_key in pairs:
            assert theirs[their_key] == pytest.approx(ours[our_key], abs=1e-9)


def test_cantools_decodes_the_wrist_in_degrees_as_the_monitor_does(generated: Path) -> None:
    data = (3600).to_bytes(2, "little") + (-1).to_bytes(2, "little", signed=True) + b"\x02\x00"
    theirs = load_dbc(generated).decode_message(0x194, data)
    assert theirs == pytest.approx({"yaw": 180.0, "pitch": -0.05, "roll": 0.1})
    said, ours = Decoder(load()).decode(0x194, data)
    assert said == "WRIST"
    assert ours == pytest.approx({"yaw deg": 180.0, "pitch deg": -0.05, "roll deg": 0.1})


@pytest.mark.parametrize("node", [0x11, 0x12, 0x13])
def test_cantools_reads_sdo_frames_as_canopen_writes_them(generated: Path, node: int) -> None:
    """Requests of the `canopen` package, and answers by CiA 301's tables, decoded by the DBC."""
    database = load_dbc(generated)
    sent: list[tuple[int, bytes]] = []

    class Recorder(canopen.Network):  # type: ignore[misc]
        def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
            sent.append((can_id, bytes(data)))

    client = canopen.sdo.SdoClient(0x600 + node, 0x580 + node, canopen.ObjectDictionary())
    client.network, client.RESPONSE_TIMEOUT, client.MAX_RETRIES = Recorder(), 0.001, 1
    with pytest.raises(canopen.SdoCommunicationError):
        client.download(0x6072, 0, (2000).to_bytes(2, "little"))
    with pytest.raises(canopen.SdoCommunicationError):
        client.upload(0x1018, 2)
    said = [database.decode_message(*frame) for frame in sent if frame[1][0] != 0x80]
    assert [(str(m["command"]), m["index"], m["subindex"], m["value"]) for m in said] == [
        ("write 2", 0x6072, 0, 2000),
        ("read", 0x1018, 2, 0),
    ]
    answers = {"60 72 60 00 00 00 00 00": ("written", 0x6072, 0, 0)}
    answers["43 18 10 02 02 04 00 00"] = ("value 4", 0x1018, 2, 0x402)
    answers["80 76 60 00 02 00 01 06"] = ("abort", 0x6076, 0, 0x06010002)
    for text, want in answers.items():
        m = database.decode_message(0x580 + node, bytes.fromhex(text))
        assert (str(m["command"]), m["index"], m["subindex"], m["value"]) == want


def test_servo_expects_the_drives_of_the_dictionary() -> None:
    dictionary, config = load(), lib.cr_servo_config_default()
    assert config.bus.vendor_id == dictionary.bus["vendor_id"]
    assert config.bus.product_code == dictionary.bus["product_code"]
    assert config.bus.revision == dictionary.bus["revision"]
    for axis, ours in zip(dictionary.axes, config.axis, strict=True):
        assert round(1000 * ours.rated) == dictionary.resolve("$RATED", axis)
        assert round(1000 * ours.torque_max / ours.rated) == axis.max_permille


def test_dbc_covers_every_cyclic_and_event_frame_of_the_timing_model(generated: Path) -> None:
    database = load_dbc(generated)
    known = {message.frame_id: message.length for message in database.messages}
    for message in load().messages():
        assert known[message.cob] == message.bytes, message.name
