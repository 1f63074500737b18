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

REPORT = {"ticks": 2400, "frames_lost": 0, "faults_done": 40, "stack_bytes": 4000}
IDLE_SEEN, FAULT_SEEN = 20, 30
ONCE, ALWAYS, HELD_UP_NS = 100, 120, 1_000_000
TICKS_MAX = 4000


@pytest.fixture(scope="module")
def scene() -> Scene:
    return open_scene(m7.SCENE)


@pytest.fixture(scope="module")
def good(scene: Scene) -> Recording:
    """Drives up, contact, drive Y silent, cleared, contact again, held up once, then three times.

    The hand does not move from inside the corner.
    """
    loop = Loop(scene, faults=[Fault("silent", tick=1285, ticks=20, axis=m7.SILENT_AXIS)])
    rendering = (int(lib.CR_MODE_RENDERING), int(lib.CR_MODE_LIMITED))
    commands = {
        int(lib.CR_MODE_IDLE): (IDLE_SEEN, int(lib.CR_COMMAND_START)),
        int(lib.CR_MODE_FAULT): (FAULT_SEEN, int(lib.CR_COMMAND_CLEAR)),
    }
    ticks, last, starts = 0, -1, 0
    period_ns = int(loop._clock.period_ns)
    for _ in range(TICKS_MAX):
        held_up = starts == 2 and last == rendering[0] and (ticks == ONCE or ticks >= ALWAYS)
        loop._clock.period_ns = period_ns + (HELD_UP_NS if held_up else 0)
        loop.tick()
        mode = rendering[0] if loop.mode in rendering else loop.mode
        ticks, last = (ticks + 1, mode) if mode == last else (0, mode)
        due, command = commands.get(mode, (-1, 0))
        if starts == 2 and mode == lib.CR_MODE_FAULT and ticks == FAULT_SEEN:
            break
        if ticks == due:
            loop.command(command)
            starts += command == lib.CR_COMMAND_START
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


def late_tick(recording: Recording, which: int) -> int:
    return int(m7.late_ticks(recording)[which])


def test_torque_that_is_not_held_is_found(good: Recording, scene: Scene) -> None:
    tick = late_tick(good, 0)
    torque = 0.5 * good.rows["torque"][tick]
    assert any(
        "torque held," in text for text in failing(changed(good, "torque", tick, torque), scene)
    )


def test_torque_that_is_not_halved_is_found(good: Recording, scene: Scene) -> None:
    tick = late_tick(good, 2)
    torque = good.rows["torque"][tick - 1].copy()
    assert any(
        "held, halved" in text for text in failing(changed(good, "torque", tick, torque), scene)
    )


def test_torque_after_three_late_ticks_is_found(good: Recording, scene: Scene) -> None:
    said = failing(changed(good, "target", late_tick(good, 3) + 5, (1, 0, 0)), scene)
    assert any("zero torque" in text for text in said)


def test_run_that_was_not_held_up_is_found(good: Recording, scene: Scene) -> None:
    said = failing(replace(good, rows=good.rows[: late_tick(good, 0)]), scene)
    assert any("0 late ticks" in text for text in said)


def test_sync_that_comes_late_is_found(good: Recording, scene: Scene) -> None:
    tick = fault_tick(good) - 20
    said = failing(changed(good, "sync_ns", tick, good.rows["sync_ns"][tick] + 20_000), scene)
    assert any("us off at most" in text for text in said)


def test_stack_beyond_its_room_is_found(good: Recording, scene: Scene) -> None:
    (text,) = failing(good, scene, {**REPORT, "stack_bytes": 9000})
    assert "9,000 bytes of stack" in text


def test_slow_core_is_judged_by_its_time_and_by_what_is_held(good: Recording, scene: Scene) -> None:
    assert all(outcome.holds for outcome in m7.judge_slow(good, scene, REPORT))
    late = changed(good, "sync_ns", fault_tick(good) - 20, 0)
    assert not all(outcome.holds for outcome in m7.judge_slow(late, scene, REPORT))


def test_record_that_is_missing_is_found(good: Recording, scene: Scene) -> None:
    rows = np.delete(good.rows, 500)
    assert failing(replace(good, rows=rows), scene)
