"""Faults on request, tick by tick. In-process, where the tick of a fault is exact; the code is the same elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from bus_tools import NODES, Link, enable, make_link, setup_layout, torques
from crease.base.errors import BusError
from crease.bus.drives import FAULT_KINDS, Drives, Fault, Frame, Params
from crease.bus.inprocess import drives_of

BEGIN = 21
"""First tick after the drives are enabled (12 SYNCs), with some to spare."""


def ticks(
    faults: Sequence[Fault], count: int = 10, permille: int = 0
) -> tuple[list[list[tuple[int, bytes]]], Drives]:
    """What the host hears in each of the ticks BEGIN, BEGIN + 1, ... with its own SYNC left out."""
    with make_link("inprocess", faults) as link:
        ready(link)
        heard = []
        for _ in range(count):
            link.heard.clear()
            link.send(0x181, torques(permille, 0, 0))
            link.sync()
            heard.append([(m.arbitration_id, bytes(m.data)) for m in link.heard])
        return heard, drives_of(link.channel)


def ready(link: Link) -> None:
    """Enabled, and at tick BEGIN - 1."""
    setup_layout(link)
    enable(link)
    link.sync(BEGIN - 1 - 12)
    assert drives_of(link.channel).counters.ticks == BEGIN - 1


def ids(heard: list[tuple[int, bytes]]) -> list[int]:
    return [cob for cob, _ in heard]


WHOLE = [0x191, 0x192, 0x193]


def test_without_faults_every_tick_is_whole() -> None:
    heard, drives = ticks([])
    assert [ids(tick) for tick in heard] == [WHOLE] * 10
    assert drives.counters.faults_done == 0


def test_drop_loses_that_frame_in_that_tick_only() -> None:
    heard, drives = ticks([Fault("drop", BEGIN + 2, ticks=2, id=0x192)])
    assert [ids(tick) for tick in heard[:5]] == [
        WHOLE,
        WHOLE,
        [0x191, 0x193],
        [0x191, 0x193],
        WHOLE,
    ]
    assert drives.counters.faults_done == 2


def test_drop_of_the_torque_frame_at_one_drive_keeps_its_old_torque() -> None:
    faults = [Fault("drop", BEGIN + 1, ticks=100, axis=0, id=0x181, to_drives=True)]
    with make_link("inprocess", faults) as link:
        ready(link)
        drives = drives_of(link.channel)
        for value in (100, 200, 300, 400):
            link.send(0x181, torques(value, value, value))
            link.sync()
    assert [drives.drive(axis).torque_permille for axis in range(3)] == [200, 400, 400]


def test_delay_brings_the_frame_later_with_what_it_said_then() -> None:
    plain, _ = ticks([], permille=300)
    heard, _ = ticks([Fault("delay", BEGIN + 2, id=0x191, value=3)], permille=300)
    assert ids(heard[2]) == [0x192, 0x193]
    assert ids(heard[5]) == [0x191, *WHOLE]
    assert heard[5][0] == plain[2][0]


def test_delay_of_the_torque_frame_makes_it_act_later() -> None:
    with make_link(
        "inprocess", [Fault("delay", BEGIN - 1, id=0x181, to_drives=True, value=3)]
    ) as link:
        ready(link)
        drives = drives_of(link.channel)
        link.send(0x181, torques(100, 0, 0))
        demands = []
        for _ in range(6):
            link.sync()
            demands.append(drives.drive(0).torque_permille)
    assert demands == [0, 0, 100, 100, 100, 100]


def test_duplicate_comes_twice_and_is_the_same() -> None:
    heard, _ = ticks([Fault("duplicate", BEGIN, id=0x193)])
    assert ids(heard[0]) == [*WHOLE, 0x193]
    assert heard[0][2] == heard[0][3]


def test_reorder_puts_the_frame_behind_the_others() -> None:
    heard, _ = ticks([Fault("reorder", BEGIN, id=0x191)])
    assert ids(heard[0]) == [0x192, 0x193, 0x191]
    assert ids(heard[1]) == WHOLE


def test_corrupt_changes_the_byte_that_was_named() -> None:
    plain, _ = ticks([])
    heard, _ = ticks([Fault("corrupt", BEGIN + 1, id=0x191, value=7 << 8 | 0x80)])
    changed = bytes(a ^ b for a, b in zip(plain[1][0][1], heard[1][0][1], strict=True))
    assert changed == bytes(7) + b"\x80"


def test_babbling_node_pushes_lower_priorities_out_of_the_tick() -> None:
    heard, drives = ticks([Fault("babble", BEGIN + 1, ticks=2, axis=2, id=0x081, value=10)])
    assert ids(heard[0]) == WHOLE
    assert 0x191 not in ids(heard[1])
    assert ids(heard[1]).count(0x081) == len(heard[1]) < 10
    assert ids(heard[-1]) == WHOLE, "the backlog is worked off"
    assert drives.counters.frames_dropped == 0


def test_silent_drive_says_nothing_and_hears_nothing_but_pushes_on() -> None:
    heard, drives = ticks([Fault("silent", BEGIN + 3, ticks=100, axis=1)], permille=100)
    assert [ids(tick) for tick in heard[2:5]] == [WHOLE, [0x191, 0x193], [0x191, 0x193]]
    assert drives.drive(1).state == "operation enabled"


def test_encoder_jump_stays_and_stuck_encoder_does_not_move() -> None:
    def position(tick: list[tuple[int, bytes]], axis: int) -> int:
        return int.from_bytes(dict(tick)[0x191 + axis][:4], "little", signed=True)

    plain, _ = ticks([], count=60, permille=1000)
    jumped, _ = ticks(
        [Fault("encoder_jump", BEGIN + 5, axis=0, value=500)], count=60, permille=1000
    )
    stuck, _ = ticks(
        [Fault("encoder_stuck", BEGIN + 20, ticks=30, axis=0)], count=60, permille=1000
    )
    assert position(plain[59], 0) > position(plain[20], 0) + 5
    assert [position(j, 0) - position(p, 0) for j, p in zip(jumped, plain, strict=True)] == [
        0
    ] * 5 + [500] * 55
    assert {position(tick, 0) for tick in stuck[20:50]} == {position(stuck[19], 0)}
    assert position(stuck[50], 0) == position(plain[50], 0)


def test_drive_reset_boots_and_gives_no_torque() -> None:
    heard, drives = ticks([Fault("drive_reset", BEGIN + 2, axis=2)])
    assert ids(heard[2]) == [0x191, 0x192, 0x713]
    assert dict(heard[2])[0x713] == b"\x00"
    assert ids(heard[9]) == [0x191, 0x192]
    assert drives.drive(2).state == "switch on disabled"


def test_bus_off_silences_the_drive_and_it_faults_by_itself() -> None:
    heard, drives = ticks([Fault("bus_off", BEGIN + 2, ticks=3, axis=0)], count=20, permille=500)
    assert [0x191 in ids(tick) for tick in heard[:6]] == [True, True, False, False, False, True]
    assert drives.drive(0).state == "fault"
    assert drives.drive(0).error_code == 0x8140
    said = [
        tick
        for tick, frames in enumerate(heard)
        if (0x691, b"\x40\x81\x11\x00\x00\x00\x00\x00") in frames
    ]
    assert said == [12], "it says so when it is back, and 10 ms after what the bus did not carry"
    assert drives.drive(0).torque_permille == 0


def test_drive_error_zeroes_the_torque_in_its_tick() -> None:
    heard, drives = ticks([Fault("drive_error", BEGIN + 2, axis=1, value=0x4310)], permille=100)
    assert (0x692, b"\x10\x43\x09\x00\x00\x00\x00\x00") in heard[2]
    assert int.from_bytes(dict(heard[2])[0x192][6:], "little") & 0x4F in (0x0F, 0x08)
    assert drives.drive(1).state == "fault"


def test_dropped_sync_at_one_drive_leaves_the_mechanism_in_step() -> None:
    heard, drives = ticks([Fault("drop", BEGIN + 4, axis=2, id=0x080, to_drives=True)])
    assert ids(heard[4]) == [0x191, 0x192]
    assert drives.state.time_s == pytest.approx(1e-3 * drives.counters.ticks)


def test_same_frames_and_faults_give_the_same_bus_to_the_bit() -> None:
    faults = [
        Fault("corrupt", BEGIN + 1, ticks=3, id=0x191, value=0x1FF),
        Fault("babble", BEGIN + 2, axis=1, id=0x090, value=9),
        Fault("encoder_jump", BEGIN + 6, axis=0, value=-77),
    ]
    first, _ = ticks(faults, count=200, permille=700)
    second, _ = ticks(faults, count=200, permille=700)
    assert first == second


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(FAULT_KINDS))
def test_every_fault_at_every_fiftieth_tick_leaves_the_drives_within_their_limits(
    kind: str,
) -> None:
    rows = [
        Fault(
            kind,
            tick,
            ticks=2,
            axis=0,
            id=0x191,
            value={"babble": 12, "drive_error": 0x2310}.get(kind, 1000),
        )
        for tick in range(50, 2001, 50)
    ]
    with make_link("inprocess", rows) as link:
        setup_layout(link)
        enable(link)
        drives = drives_of(link.channel)
        while drives.counters.ticks < 2100:
            link.send(0x181, torques(32767, -32768, 32767))
            link.sync()
            link.heard.clear()
            for axis, most in enumerate((2000, 2500, 2500)):
                one = drives.drive(axis)
                assert abs(one.torque_permille) <= most
                assert one.torque_permille == 0 or one.state == "operation enabled"
        state = drives.state
    assert abs(state.joint).max() < 10.0
    assert drives.counters.faults_done > 0


def test_fault_table_refuses_rows_out_of_range() -> None:
    drives = Drives()
    for bad in (Fault("flood", 1), Fault("drop", 1, axis=3), Fault("drop", 1, id=0x800)):
        with pytest.raises(BusError):
            drives.set_faults([bad])
    with pytest.raises(BusError):
        drives.set_faults([Fault("drop", 1)] * 65)


def test_parameters_out_of_range_or_unknown_are_refused() -> None:
    refused: list[dict[str, Any]] = [
        {"hand_mass": 1.0},
        {"period_s": float("nan")},
        {"axes": {"W": {}}},
        {"axes": {"X": {"mass": 1.0}}},
    ]
    for bad in refused:
        with pytest.raises(BusError):
            Params(**bad)
    with pytest.raises(BusError):
        Drives(Params(stroke_m=-1.0))


def test_frames_of_any_shape_do_no_harm() -> None:
    drives = Drives()
    for cob in range(0x800):
        for length in (0, 1, 3, 8):
            drives.receive(Frame(cob, bytes([0xFF] * length)), 1000)
            drives.receive(Frame(cob, bytes(length)), 1000)
    drives.poll(10_000)
    assert len(drives.send()) > 0
    assert all(drives.drive(axis).torque_permille == 0 for axis in range(3))
    assert len(NODES) == 3
