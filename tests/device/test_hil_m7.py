"""The checks of `make hil-m7` can fail: each is shown a run that is wrong.

The run is made in process, with the board's script.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import m7
import numpy as np
import pytest
from crease.base.native import lib
from crease.base.scene import Scene, open_scene
from crease.bus.drives import Fault
from crease.loop.hil import Loop
from crease.replay.recording import Recording

REPORT = {"ticks": 2400, "frames_lost": 0, "faults_done": 40}
IDLE_SEEN, FAULT_SEEN, RENDER_TICKS = 20, 30, 100
TICKS_MAX = 4000


@pytest.fixture(scope="module")
def scene() -> Scene:
    return open_scene(m7.SCENE)


@pytest.fixture(scope="module")
def good(scene: Scene) -> Recording:
    """Drives up, contact, drive Y silent, cleared, contact again: the hand does not move from inside the corner."""
    loop = Loop(scene, faults=[Fault("silent", tick=1285, ticks=20, axis=m7.SILENT_AXIS)])
    rendering = (int(lib.CR_MODE_RENDERING), int(lib.CR_MODE_LIMITED))
    commands = {
        int(lib.CR_MODE_IDLE): (IDLE_SEEN, int(lib.CR_COMMAND_START)),
        int(lib.CR_MODE_FAULT): (FAULT_SEEN, int(lib.CR_COMMAND_CLEAR)),
    }
    ticks, last, starts = 0, -1, 0
    for _ in range(TICKS_MAX):
        loop.tick()
        mode = rendering[0] if loop.mode in rendering else loop.mode
        ticks, last = (ticks + 1, mode) if mode == last else (0, mode)
        due, command = commands.get(mode, (-1, 0))
        if ticks == due:
            loop.command(command)
            starts += command == lib.CR_COMMAND_START
        if starts == 2 and mode == rendering[0] and ticks == RENDER_TICKS:
            break
    return loop.result(0).recording


def failing(recording: Recording, scene: Scene, report: dict[str, Any] = REPORT) -> list[str]:
    """What does not hold."""
    return [outcome.text for outcome in m7.judge(recording, scene, report) if not outcome.holds]


def changed(recording: Recording, name: str, tick: int, value: object) -> Recording:
    """The same with one field of one record changed."""
    rows = recording.rows.copy()
    rows[name][tick] = value
    return replace(recording, rows=rows)


def fault_tick(recording: Recording) -> int:
    return int(np.argmax(recording.rows["mode"] == lib.CR_MODE_FAULT))


def test_whole_run_holds(good: Recording, scene: Scene) -> None:
    assert failing(good, scene) == []


def test_last_bit_of_one_force_is_found(good: Recording, scene: Scene) -> None:
    tick = fault_tick(good) - 20
    force = good.rows["force_N"][tick].copy()
    force[0] = np.nextafter(force[0], np.float32(1e9))
    (text,) = failing(changed(good, "force_N", tick, force), scene)
    assert "1 different" in text


def test_torque_in_a_fault_is_found(good: Recording, scene: Scene) -> None:
    said = failing(changed(good, "target", fault_tick(good) + 5, (1, 0, 0)), scene)
    assert any("zero torque" in text for text in said)


def test_run_without_the_fault_is_found(good: Recording, scene: Scene) -> None:
    said = failing(replace(good, rows=good.rows[: fault_tick(good)]), scene)
    assert any(text.startswith("fault: none") for text in said)
    assert any("after it was cleared" in text for text in said)


def test_drive_that_is_not_enabled_is_found(good: Recording, scene: Scene) -> None:
    rows = good.rows.copy()
    rows["status"][:, 2] = 0x0233
    said = failing(replace(good, rows=rows), scene)
    assert any("OPERATION ENABLED" in text for text in said)


def test_frames_lost_at_the_drives_are_found(good: Recording, scene: Scene) -> None:
    (text,) = failing(good, scene, {**REPORT, "frames_lost": 1})
    assert "1 frames lost" in text


def test_record_that_is_missing_is_found(good: Recording, scene: Scene) -> None:
    rows = np.delete(good.rows, 500)
    assert failing(replace(good, rows=rows), scene)
