"""A servo that hears another host before it has spoken: it says nothing, for as long as it is left alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from crease.base.native import ffi, lib
from crease.base.scene import open_scene
from crease.bus.drives import Frame
from crease.loop.hil import Loop
from crease.replay.recording import fault_names

TICKS = 700
ALIEN_TICK = 5


@pytest.mark.parametrize("cob", [0x000, 0x080, 0x181, 0x211, 0x611, 0x701])
def test_servo_that_hears_another_host_while_listening_sends_nothing(
    scene_crs: Path, cob: int
) -> None:
    loop = Loop(open_scene(scene_crs))
    sent: list[Frame] = []
    loop.on_frame = lambda _, frame: sent.append(frame)
    alien = ffi.new("cr_frame *", {"id": cob, "size": 0})
    for tick in range(TICKS):
        if tick == ALIEN_TICK:
            lib.cr_servo_rx(loop.servo.c, alien)
        loop.tick()
    status = lib.cr_servo_get_status(loop.servo.c)
    assert fault_names(int(status.faults)) == ["alien"]
    boots = [frame for frame in sent if frame.id in (0x711, 0x712, 0x713)]
    assert sent == boots, "the drives' own boot-up, and nothing of the host"
    assert loop.drives.counters.frames_in == loop.drives.counters.frames_ignored == 0


def test_refused_servo_listens_again_on_clear(scene_crs: Path) -> None:
    loop = Loop(open_scene(scene_crs))
    lib.cr_servo_rx(loop.servo.c, ffi.new("cr_frame *", {"id": 0x080, "size": 0}))
    for _ in range(100):
        loop.tick()
    assert loop.mode == lib.CR_MODE_FAULT
    loop.command(int(lib.CR_COMMAND_CLEAR))
    for _ in range(2500):
        loop.tick()
    assert loop.mode == lib.CR_MODE_IDLE
