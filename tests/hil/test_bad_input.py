"""What creased refuses, or faults on, with one clear line."""

from __future__ import annotations

from pathlib import Path

import can
import pytest
from hil_tools import CHANNEL, closed_loop, of, run_creased, torques_of


@pytest.mark.parametrize(
    ("device", "interface", "status", "text"),
    [
        ("", "vcan7", 3, "vcan7: no such interface"),
        ("[bus]\nbaud = 1\n", CHANNEL, 2, "unknown key 'baud' in [bus]"),
        ("[guide]\nstep_mm = 0.06\n", CHANNEL, 2, "its unit is another: write step_m"),
        ("[control]\nforce_max_N = -3\n", CHANNEL, 2, "force_max_N = -3 is out of range"),
        ("[bus]\nbitrate_bit_s = 500000\n", CHANNEL, 2, "only 1000000 is possible"),
    ],
)
def test_creased_refuses_with_one_line(
    scene: Path, tmp_path: Path, device: str, interface: str, status: int, text: str
) -> None:
    config, record = tmp_path / "device.toml", tmp_path / "run.crr"
    config.write_text(device, encoding="ascii")
    said = run_creased("--config", config, "--interface", interface, "--record", record, scene)
    assert said.returncode == status
    assert text in said.stderr
    assert said.stderr.startswith("error: ")
    assert (said.stderr.count("\n"), said.stdout) == (1, "")
    assert not record.exists(), "nothing half written"


def test_creased_keeps_an_old_record(scene: Path, tmp_path: Path) -> None:
    config, record = tmp_path / "device.toml", tmp_path / "run.crr"
    config.write_text("", encoding="ascii")
    record.write_text("yesterday's", encoding="ascii")
    said = run_creased("--config", config, "--interface", CHANNEL, "--record", record, scene)
    assert (said.returncode, said.stdout) == (1, "")
    assert said.stderr == f"error: {record}: is there already; --force replaces it\n"
    assert record.read_text(encoding="ascii") == "yesterday's"


@pytest.mark.parametrize("cob", [0x000, 0x080, 0x181, 0x211, 0x601 + 0x10, 0x701])
def test_frame_of_a_second_host_is_a_fault_that_is_named(scene: Path, cob: int) -> None:
    with closed_loop(scene, "--exit-on-fault") as loop:
        before = loop.listen(2.3)
        assert any(any(torques_of(data)) for _, data in of(before, 0x181)[-50:])
        data = {0x080: b"", 0x181: bytes(6), 0x701: b"\x05"}.get(cob, bytes(8))
        loop.bus.send(can.Message(arbitration_id=cob, data=data, is_extended_id=False))
        after = loop.listen(0.3)
        text = loop.creased.communicate(timeout=10)[0]
    assert loop.creased.returncode == 4
    assert [line for line in text.splitlines() if ": fault: " in line and "alien" in line], text
    ours = [data for _, data in of(after, 0x181)]
    assert not [data for data in ours[3:] if any(torques_of(data))]
