"""The firmware and the simulated drives in two processes, on a real vcan."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from bus_tools import Link
from hil_tools import NODES, closed_loop, enabled, late_syncs, of, torques_of

VIRTUAL_TIME = os.environ.get("CREASE_VIRTUAL_TIME") == "1"

DEADLINE_S = 0.003
"""The time that the host sets in 0x1401:5 of every drive: silence of the torque frame."""

HEARTBEAT_S = 0.150
"""The time that the host sets in 0x1016 of every drive."""


def test_firmware_brings_the_drives_up_and_runs_without_a_missed_tick(scene: Path) -> None:
    with closed_loop(scene, "--seconds", "3") as loop:
        heard = loop.listen(4.0)
        text = loop.creased.communicate(timeout=10)[0]
        assert loop.creased.returncode == 0, text
        assert "rendering" in text
        loop.sim.send_signal(signal.SIGINT)
        report = json.loads(loop.sim.communicate(timeout=10)[0])
    assert report["frames_lost"] == 0
    syncs = of(heard, 0x080)
    assert len(syncs) >= 2900
    assert late_syncs(heard) <= (0 if VIRTUAL_TIME else 30), (
        "in real time a shared machine may lose one in a hundred"
    )
    for node in NODES:
        states = of(heard, 0x180 + node)
        assert sum(enabled(data) for _, data in states) > 1500
    assert any(any(torques_of(data)) for _, data in of(heard, 0x181)), (
        "gravity and friction are compensated"
    )
    for _, data in of(heard, 0x181):
        assert all(
            abs(word) <= most
            for word, most in zip(torques_of(data), (2000, 2500, 2500), strict=True)
        )
    assert not [1 for _, data in of(heard, 0x181)[-2:] if any(torques_of(data))], (
        "it ends with zero torque"
    )


def test_killed_firmware_leaves_the_drives_at_zero_torque_within_the_torque_deadline(
    scene: Path,
) -> None:
    with closed_loop(scene) as loop:
        before = loop.listen(2.5)
        assert any(any(torques_of(data)) for _, data in of(before, 0x181)[-100:])
        loop.creased.kill()
        after = loop.listen(0.5)
        frames = [*before, *after]
        last_beat_s = of(frames, 0x701)[-1][0]
        last_torque_s = of(frames, 0x181)[-1][0]
        for node in NODES:
            errors = of(after, 0x680 + node)
            codes = [data[:2] for _, data in errors]
            assert codes == [b"\x50\x82", b"\x30\x81"], f"drive 0x{node:X} did not notice"
            assert DEADLINE_S < errors[0][0] - last_torque_s <= DEADLINE_S + 0.002
            assert HEARTBEAT_S < errors[1][0] - last_beat_s <= HEARTBEAT_S + 0.002
        link = Link("socketcan", "vcan0", loop.bus)
        for node in NODES:
            assert link.read(node, 0x6074, 0) == 0
            assert link.read(node, 0x6041, 0) & 0x4F == 0x08


@pytest.mark.parametrize("after_s", [2.0, 2.1013])
def test_killed_drives_make_the_firmware_fault_within_three_milliseconds(
    scene: Path, after_s: float
) -> None:
    with closed_loop(scene, "--exit-on-fault") as loop:
        before = loop.listen(after_s)
        assert enabled(of(before, 0x191)[-1][1])
        assert all(any(torques_of(data)) for _, data in of(before, 0x181)[-50:])
        loop.sim.kill()
        after = loop.listen(0.5)
        text = loop.creased.communicate(timeout=10)[0]
        assert loop.creased.returncode == 4, text
        frames = [*before, *after]
        last_state_s = max(of(frames, 0x180 + node)[-1][0] for node in NODES)
        late = [data for time_s, data in of(after, 0x181) if time_s > last_state_s + 0.0031]
        assert not [data for data in late if any(torques_of(data))], (
            "torque was still asked for after 3 ms"
        )
