"""The bus in its true time: bits of every frame, arbitration, and a deadline that is too short for them."""

from __future__ import annotations

import random
import re
from pathlib import Path

import numpy as np
import pytest
from crease.base.native import lib
from crease.base.scene import open_scene
from crease.bus.dictionary import load
from crease.bus.drives import Drives, Frame, Wire, wire_bits
from crease.bus.schedule import cycle, frame_bits
from crease.loop.hil import Loop
from crease.replay.recording import fault_names

TICKS = 3000


def bits_by_hand(frame: Frame) -> int:
    """ISO 11898-1: SOF, identifier, three dominant bits, DLC, data, CRC by long division; stuffed; 13 bits of tail."""
    text = f"0{frame.id:011b}000{len(frame.data):04b}" + "".join(
        f"{byte:08b}" for byte in frame.data
    )
    rest, generator = int(text, 2) << 15, 0b1100010110011001
    while rest.bit_length() > 15:
        rest ^= generator << (rest.bit_length() - 16)
    stuffed, left = "", f"{text}{rest:015b}"
    while found := re.match(r"(.*?)(00000|11111)", left):
        stuffed += found[0]
        left = "01"[found[2][0] == "0"] + left[found.end() :]
    return len(stuffed + left) + 13


def test_frame_has_the_bits_that_its_content_asks_for() -> None:
    dice = random.Random(11)
    assert wire_bits(Frame(0x555, b"")) == bits_by_hand(Frame(0x555, b"")) >= 47
    for _ in range(4000):
        data = bytes(
            dice.choice((0x00, 0xFF, dice.randrange(256))) for _ in range(dice.randrange(9))
        )
        frame = Frame(dice.randrange(0x800), data)
        assert wire_bits(frame) == bits_by_hand(frame), frame
        assert 47 + 8 * len(data) <= wire_bits(frame) <= frame_bits(len(data))


def test_lowest_identifier_goes_first_and_nothing_is_interrupted() -> None:
    """Three boot-up frames wait; the host's NMT comes in the midst of the first and goes second."""
    wire = Wire(Drives())
    first = wire_bits(Frame(0x711, b"\0")) * 1000
    assert wire.put(Frame(0x000, b"\x80\0"), first // 2)
    came = []
    while (item := wire.get(1_000_000)) is not None:
        came.append(item)
    nmt = wire_bits(Frame(0x000, b"\x80\0")) * 1000
    second = wire_bits(Frame(0x712, b"\0")) * 1000
    assert [frame.id for frame, _ in came] == [0x711, 0x712, 0x713]
    assert [at for _, at in came[:2]] == [first, first + nmt + second]


def test_host_queue_refuses_what_does_not_fit() -> None:
    wire = Wire(Drives())
    taken = [wire.put(Frame(0x080, b""), 0) for _ in range(40)]
    assert taken == [True] * 32 + [False] * 8


@pytest.mark.parametrize("deadline_us", [350, 400])
def test_loop_with_a_deadline_before_the_states_does_not_come_up(
    scene_crs: Path, deadline_us: int
) -> None:
    """SYNC and three states take 410 us and more: a tick at 400 us never has all three."""
    loop = Loop(open_scene(scene_crs), deadline_ns=1000 * deadline_us)
    for _ in range(TICKS):
        loop.tick()
    faults = fault_names(int(lib.cr_servo_get_status(loop.servo.c).faults))
    assert faults == ["drive-state"], "the drives are never seen enabled, all three in one period"


def test_loop_with_the_deadline_of_the_schedule_misses_no_state(scene_crs: Path) -> None:
    loop = Loop(open_scene(scene_crs))
    for _ in range(TICKS):
        loop.tick()
    rows = loop.result(0).recording.rows
    idle = rows[rows["mode"] == lib.CR_MODE_IDLE]
    waited_us = 1e-3 * (idle["now_ns"] - idle["sync_ns"]).astype(np.float64)
    bound = cycle(load())
    assert len(idle) > 1500
    assert 396.0 < waited_us.min() <= waited_us.max() <= bound.answers_us
    assert rows["counters"]["missing"][-1].sum() == rows["counters"]["late"][-1] == 0


@pytest.mark.parametrize(("compute_us", "in_time"), [(210, True), (405, True), (700, False)])
def test_computation_within_the_budget_keeps_every_sync_in_time(
    scene_crs: Path, compute_us: int, in_time: bool
) -> None:
    """A torque frame that leaves too late holds up the next SYNC, and the states that follow it."""
    loop = Loop(open_scene(scene_crs), compute_ns=1000 * compute_us)
    for _ in range(TICKS):
        loop.tick()
    rows = loop.result(0).recording.rows
    after = rows[-1000:]
    waited_us = 1e-3 * (after["now_ns"] - after["sync_ns"]).astype(np.float64)
    assert (float(waited_us.max()) <= cycle(load()).answers_us) is in_time
