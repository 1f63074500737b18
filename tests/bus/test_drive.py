"""The simulated drives, spoken to by an independent CANopen client and frame by frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import can
import canopen
import pytest
from bus_tools import NMT, NODES, Link, enable, last_state, setup_layout, torques
from canopen.profiles.p402 import BaseNode402

ENABLED, FAULT = 0x27, 0x08


@contextmanager
def syncing(link: Link) -> Iterator[None]:
    """SYNC every 2 ms beside the program: the 402 client waits for synchronous TPDOs."""
    stop = threading.Event()

    def run() -> None:
        while not stop.is_set():
            link.send(0x080)
            time.sleep(0.002)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextmanager
def network(link: Link) -> Iterator[canopen.Network]:
    """canopen's network on the host's end."""
    net = canopen.Network(bus=link.bus)
    net.notifier = can.Notifier(link.bus, net.listeners, 0.1)
    try:
        yield net
    finally:
        net.notifier.stop()


def prepare_402(net: canopen.Network, generated: Path) -> BaseNode402:
    """Axis X as the client sees it, with the layout of the bus set up by the client itself."""
    node = BaseNode402(NODES[0], str(generated / "crease_x.eds"))
    net.add_node(node)
    node.nmt.send_command(0x80)
    node.nmt._state = 0x7F
    node.pdo.read()
    tpdo, control, torque = node.tpdo[1], node.rpdo[1], node.rpdo[2]
    tpdo.clear()
    for index in (0x6064, 0x6077, 0x6041):
        tpdo.add_variable(index)
    tpdo.trans_type, tpdo.enabled = 1, True
    control.clear()
    control.add_variable(0x6040)
    control.add_variable(0x6060)
    control.trans_type, control.enabled = 255, True
    torque.clear()
    torque.add_variable(0x6071)
    torque.add_variable(0x0003)
    torque.add_variable(0x0003)
    torque.trans_type, torque.cob_id, torque.enabled = 1, 0x181, True
    node.pdo.save()
    node.setup_402_state_machine()
    node.nmt.send_command(0x01)
    return node


@pytest.mark.slow
@pytest.mark.quiet
def test_unmodified_402_client_enables_runs_faults_and_resets(link: Link, generated: Path) -> None:
    with network(link) as net:
        node = prepare_402(net, generated)
        assert [m[0].index for m in (node.rpdo[1], node.rpdo[2])] == [0x6040, 0x6071]
        assert [v.index for v in node.rpdo[2]] == [0x6071, 0x0003, 0x0003]
        with syncing(link):
            node.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
            assert node.op_mode == "CYCLIC SYNCHRONOUS TORQUE"
            node.state = "OPERATION ENABLED"
            assert node.state == "OPERATION ENABLED"
            for _ in range(20):
                link.send(0x181, torques(300, 0, 0))
                time.sleep(0.002)
            assert node.sdo[0x6074].raw == 300
            assert node.tpdo_values[0x6064] > 0
            node.state = "QUICK STOP ACTIVE"
            assert node.sdo[0x6074].raw == 0
            node.state = "OPERATION ENABLED"
            node.sdo[0x1401][
                5
            ].raw = 3  # torque frames have stopped: with a deadline that is an error
            link.send(0x181, torques(0, 0, 0))
            end_s = time.monotonic() + 2.0
            while not node.is_faulted() and time.monotonic() < end_s:
                node.check_statusword()
            assert node.state == "FAULT"
            assert node.sdo[0x603F].raw == 0x8250
            assert node.emcy.wait(0x8250, 1.0) is not None or node.emcy.active
            node.sdo[0x1401][5].raw = 0
            node.reset_from_fault()
            assert node.state == "OPERATION ENABLED"
            assert node.sdo[0x1001].raw == 0


def test_torque_acts_at_the_sync_after_it_came(link: Link) -> None:
    setup_layout(link)
    enable(link)
    link.send(0x181, torques(100, 200, -300))
    assert link.read(0x11, 0x6074, 0) == 0
    link.sync()
    assert [link.read(node, 0x6074, 0) for node in NODES] == [100, 200, (-300) & 0xFFFF]


def test_state_frame_comes_once_per_sync_and_from_every_axis(link: Link) -> None:
    setup_layout(link)
    link.drain()
    link.heard.clear()
    link.sync(25)
    link.settle()
    assert [len(link.frames(0x180 + node)) for node in NODES] == [25, 25, 25]
    assert last_state(link, 0x11)[2] & 0x4F == 0x40


@pytest.mark.slow
@pytest.mark.quiet
def test_heartbeat_of_the_host_stops_and_torque_goes_to_zero(link: Link) -> None:
    heartbeat_ms = (
        500 if link.transport == "virtual" else 30
    )  # that one runs in real time, however busy the machine
    setup_layout(link, heartbeat_ms=heartbeat_ms)
    link.send(0x701, [5])
    enable(link)
    link.send(0x181, torques(200, 0, 0))
    link.sync(3)
    assert last_state(link, 0x11)[2] & 0x6F == ENABLED
    for _ in range(2 * heartbeat_ms):
        link.send(0x181, torques(200, 0, 0))
        link.sync()
    for node in NODES:
        assert last_state(link, node)[2] & 0x4F == FAULT
        assert link.frames(0x680 + node)[0][:3] == b"\x30\x81\x11"
        assert link.read(node, 0x6074, 0) == 0
    link.send(0x701, [5])
    for node in NODES:
        link.send(0x200 + node, b"\x00\x00\x0a")
    link.sync(2)
    link.heard.clear()
    enable(link)
    assert last_state(link, 0x13)[2] & 0x6F == ENABLED, "a fault is left on command, and only so"


def test_emergency_moves_to_its_new_identifier_and_keeps_its_inhibit_time(link: Link) -> None:
    setup_layout(link)
    for _ in range(3):
        link.send(0x181, [0, 0])  # too short for its mapping: 0x8210
        link.sync()
    link.sync(40)
    link.settle()
    times = [m.timestamp for m in link.heard if m.arbitration_id == 0x691]
    assert len(times) == 3
    if link.transport != "virtual":  # its stamps are those of a busy thread
        assert min(b - a for a, b in pairwise(times)) >= 0.009
    assert not link.frames(0x091)
    assert link.read(0x11, 0x1003, 1) == 0x8210
    assert link.read(0x11, 0x1003, 0) == 3
    assert link.write(0x11, 0x1003, 0, 0, 1) == 0
    assert link.read(0x11, 0x1003, 0) == 0


@pytest.mark.parametrize(
    ("index", "sub", "value", "size", "abort"),
    [
        (0x5000, 0, 0, 4, 0x06020000),  # no such object
        (0x1018, 9, 0, 4, 0x06090011),  # no such sub-index
        (0x6041, 0, 0, 2, 0x06010002),  # read only
        (0x6040, 0, 6, 4, 0x06070010),  # wrong length
        (0x6060, 0, 1, 1, 0x06090030),  # a mode it does not have
        (0x6072, 0, 5000, 2, 0x06090030),  # above the drive's peak
        (0x1014, 0, 0x693, 4, 0x06090030),  # identifier changed while in use
        (0x1014, 0, 0x80000701, 4, 0x06090030),  # a restricted identifier
        (0x1800, 1, 0x20000191, 4, 0x06090030),  # 29 bits
        (0x1800, 2, 252, 1, 0x06090030),  # remote frames are not spoken
        (0x1600, 1, 0x60400010, 4, 0x08000022),  # mapping of a PDO in use
        (0x1003, 0, 1, 1, 0x06090030),
    ],
)
def test_sdo_refuses_with_the_right_abort_code(
    link: Link, index: int, sub: int, value: int, size: int, abort: int
) -> None:
    assert link.write(0x11, index, sub, value, size) == abort


def test_mapping_is_checked_when_it_is_switched_on(link: Link) -> None:
    assert link.write(0x11, 0x1A00, 0, 0, 1) == 0x08000022
    assert link.write(0x11, 0x1800, 1, 0xC0000191, 4) == 0
    assert link.write(0x11, 0x1A00, 0, 0, 1) == 0
    assert link.write(0x11, 0x1A00, 1, 0x60400010, 4) == 0x06040041, "controlword is not for TPDOs"
    assert link.write(0x11, 0x1A00, 1, 0x60640010, 4) == 0x06040041, "position has 32 bits"
    assert link.write(0x11, 0x1A00, 1, 0x00030010, 4) != 0, "dummies are for RPDOs"
    for sub in (1, 2, 3):
        assert link.write(0x11, 0x1A00, sub, 0x60640020, 4) == 0
    assert link.write(0x11, 0x1A00, 0, 3, 1) == 0x06040042, "96 bits do not fit"
    assert link.write(0x11, 0x1A00, 0, 2, 1) == 0


def test_segmented_and_unknown_requests_are_aborted_not_ignored(link: Link) -> None:
    for command in (0x21, 0x00, 0xC0):
        answer = link.sdo(0x12, [command, 0x40, 0x60, 0, 20, 0, 0, 0])
        assert answer[0] == 0x80
        assert int.from_bytes(answer[4:], "little") == 0x05040001


def test_short_sdo_and_foreign_frames_leave_the_drive_alone(link: Link) -> None:
    link.send(0x611, [0x40, 0x00, 0x10])
    link.send(0x7E5, [1, 2, 3])
    link.send(NMT, [0x81])
    assert link.read(0x11, 0x1000, 0) == 0x00020192


def test_reset_brings_back_power_on_values_and_says_so(link: Link) -> None:
    setup_layout(link)
    enable(link)
    link.heard.clear()
    link.send(NMT, [0x81, 0x12])
    link.wait(0x712)
    assert link.read(0x12, 0x1401, 1) == 0x80000312
    assert link.read(0x12, 0x6041, 0) & 0x4F == 0x40
    link.sync(3)
    assert last_state(link, 0x11)[2] & 0x6F == ENABLED, "the others run on"


def test_leaving_operational_takes_the_torque_away(link: Link) -> None:
    setup_layout(link)
    enable(link)
    link.send(0x181, torques(0, 500, 0))
    link.sync(2)
    assert link.read(0x12, 0x6074, 0) == 500
    link.send(NMT, [0x80, 0])
    assert link.read(0x12, 0x6074, 0) == 0
    assert link.read(0x12, 0x6041, 0) & 0x6F == 0x23


def test_target_beyond_the_peak_is_cut_and_flagged(link: Link) -> None:
    setup_layout(link)
    enable(link)
    link.send(0x181, torques(32767, -32768, 100))
    link.sync(2)
    assert link.read(0x11, 0x6074, 0) == 2000
    assert link.read(0x12, 0x6074, 0) == (-2500) & 0xFFFF
    assert last_state(link, 0x11)[2] & 0x800
    assert not last_state(link, 0x13)[2] & 0x800


def test_default_status_pdo_comes_on_change_only(link: Link) -> None:
    link.send(NMT, [0x01, 0x11])
    link.wait(0x191)
    link.send(0x211, b"\x06\x00")
    link.wait(0x191)
    assert [int.from_bytes(d, "little") & 0x6F for d in link.frames(0x191)] == [0x40, 0x21]
