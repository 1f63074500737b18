"""A bus with the simulated drives on it, whatever carries it, and what tests do with one."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import can
from crease.bus import inprocess
from crease.bus.drives import Drives, Fault
from crease.bus.transport import ServeThread, open_bus

SYNC, NMT, TORQUE = 0x080, 0x000, 0x181
NODES = (0x11, 0x12, 0x13)
_NUMBER = itertools.count()
CHANNEL_SOCKETCAN = "vcan0"


@dataclass
class Link:
    """The host's end of a bus. In-process time stands still between SYNCs; elsewhere it is the clock's."""

    transport: str
    channel: str
    bus: can.BusABC
    heard: list[can.Message] = field(default_factory=list)

    def send(self, cob: int, data: Sequence[int] | bytes = b"") -> None:
        """One frame."""
        self.bus.send(can.Message(arbitration_id=cob, data=bytes(data), is_extended_id=False))

    def sync(self, count: int = 1) -> None:
        """SYNC frames a millisecond apart; what is heard meanwhile is kept."""
        for _ in range(count):
            self.send(SYNC)
            self.pause(0.001)
            self.drain()

    def pause(self, time_s: float) -> None:
        """Let the drives act where they have a clock of their own; in-process they already have."""
        if self.transport != "inprocess":
            time.sleep(time_s)

    def drain(self) -> None:
        """Take what has come."""
        while (message := self.bus.recv(timeout=0)) is not None:
            self.heard.append(message)

    def wait(self, cob: int, timeout_s: float = 10.0) -> can.Message:
        """The next frame with this identifier.   Errors: AssertionError when none comes."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            message = self.bus.recv(timeout=max(end_s - time.monotonic(), 0.0))
            if message is not None:
                self.heard.append(message)
                if message.arbitration_id == cob:
                    return message
        raise AssertionError(f"no frame 0x{cob:03X} within {timeout_s} s on {self.transport}")

    def settle(self) -> None:
        """Until the drives have handled all that was sent: they answer in order. However slow the machine is."""
        self.read(NODES[0], 0x1000, 0)

    def frames(self, cob: int) -> list[bytes]:
        """Payloads heard so far with this identifier."""
        self.drain()
        return [bytes(m.data) for m in self.heard if m.arbitration_id == cob]

    def sdo(self, node: int, request: Sequence[int]) -> bytes:
        """One SDO request, one answer."""
        self.send(0x600 + node, request)
        return bytes(self.wait(0x580 + node).data)

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> int:
        """Expedited download; gives the abort code, 0 when written."""
        command = 0x23 | (4 - size) << 2
        data = bytes([command, index & 0xFF, index >> 8, sub]) + (value & 0xFFFFFFFF).to_bytes(
            4, "little"
        )
        answer = self.sdo(node, data)
        return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0

    def read(self, node: int, index: int, sub: int) -> int:
        """Expedited upload.   Errors: AssertionError with the abort code."""
        answer = self.sdo(node, [0x40, index & 0xFF, index >> 8, sub, 0, 0, 0, 0])
        value = int.from_bytes(answer[4:], "little")
        assert answer[0] != 0x80, f"abort 0x{value:08X}"
        return value


@contextmanager
def make_link(transport: str, faults: Sequence[Fault] = ()) -> Iterator[Link]:
    """A fresh bus with fresh drives."""
    channel = f"test{next(_NUMBER)}"
    with ExitStack() as stack:
        if transport == "inprocess":
            inprocess.prepare(channel, Drives(faults=faults))
            bus = stack.enter_context(open_bus("inprocess", channel))
        elif transport == "virtual":
            bus = stack.enter_context(open_bus("virtual", channel))
            from crease.bus.transport import now_us

            drives = Drives(faults=faults, now_us=now_us())
            stack.enter_context(ServeThread(open_bus("virtual", channel), drives))
        else:
            channel = CHANNEL_SOCKETCAN
            bus = stack.enter_context(open_bus("socketcan", channel))
            stack.enter_context(_sim_process(faults))
        link = Link(transport, channel, bus)
        _await_boot(link)
        yield link


@contextmanager
def _sim_process(faults: Sequence[Fault]) -> Iterator[subprocess.Popen[bytes]]:
    """`crease sim` on vcan0, ended when the block ends."""
    options: list[str] = []
    for f in faults:
        text = f"{f.kind}:tick={f.tick}"
        text += f",ticks={f.ticks}" if f.ticks != 1 else ""
        text += "" if f.axis is None else f",axis={'XYZ'[f.axis]}"
        text += f",id={f.id}" if f.id else ""
        text += ",to=drives" if f.to_drives else ""
        text += f",value={f.value}" if f.value else ""
        options += ["--fault", text]
    command = [
        sys.executable,
        "-m",
        "crease",
        "sim",
        "-i",
        "socketcan",
        "-c",
        CHANNEL_SOCKETCAN,
        *options,
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0


def _await_boot(link: Link) -> None:
    """Until every drive answers: in-process they have sent their boot-up with the first frame."""
    if link.transport == "inprocess":
        link.send(NMT, [0x80, 0])
        link.drain()
        return
    seen: set[int] = set()
    end_s = time.monotonic() + 20.0
    while len(seen) < len(NODES) and time.monotonic() < end_s:
        message = link.bus.recv(timeout=0.1)
        if message is None:  # the drives may have started before we listened
            link.send(NMT, [0x81, 0])
        elif message.arbitration_id - 0x700 in NODES:
            seen.add(message.arbitration_id)
    assert len(seen) == len(NODES), "the drives did not boot"
    time.sleep(0.02)
    link.drain()
    link.heard.clear()


def setup_layout(link: Link, deadline_ms: int = 0, heartbeat_ms: int = 0) -> None:
    """The layout of the bus over SDO, as a host does it, and every drive operational."""
    for axis, node in enumerate(NODES):
        words = [0x00030010] * 3
        words[axis] = 0x60710010
        steps = [
            (0x1014, 0, 0x80000680 + node, 4), (0x1015, 0, 100, 2), (0x1014, 0, 0x680 + node, 4),
            (0x1016, 1, 0x10000 | heartbeat_ms, 4),
            (0x1400, 1, 0x80000200 + node, 4), (0x1600, 0, 0, 1), (0x1600, 1, 0x60400010, 4),
            (0x1600, 2, 0x60600008, 4), (0x1600, 0, 2, 1), (0x1400, 2, 255, 1), (0x1400, 1, 0x200 + node, 4),
            (0x1401, 1, 0x80000181, 4), (0x1601, 0, 0, 1),
            *((0x1601, i + 1, words[i], 4) for i in range(3)),
            (0x1601, 0, 3, 1), (0x1401, 2, 1, 1), (0x1401, 5, deadline_ms, 2), (0x1401, 1, 0x181, 4),
            (0x1800, 1, 0xC0000180 + node, 4), (0x1A00, 0, 0, 1), (0x1A00, 1, 0x60640020, 4),
            (0x1A00, 2, 0x60770010, 4), (0x1A00, 3, 0x60410010, 4), (0x1A00, 0, 3, 1), (0x1800, 2, 1, 1),
            (0x1800, 1, 0x40000180 + node, 4),
        ]  # fmt: skip
        for index, sub, value, size in steps:
            assert link.write(node, index, sub, value, size) == 0, f"{index:04X}:{sub}"
    link.send(NMT, [0x01, 0])


def enable(link: Link, nodes: Sequence[int] = NODES) -> None:
    """Controlword by controlword to operation enabled, cyclic synchronous torque."""
    for word in (0x80, 0x06, 0x07, 0x0F):
        for node in nodes:
            link.send(0x200 + node, word.to_bytes(2, "little") + b"\x0a")
        link.sync(3)


def torques(*permille: int) -> bytes:
    """The torque frame."""
    return b"".join(value.to_bytes(2, "little", signed=True) for value in permille)


def last_state(link: Link, node: int) -> tuple[int, int, int]:
    """Position, torque, statusword of the newest state frame."""
    link.settle()
    data = link.frames(0x180 + node)[-1]
    word = int.from_bytes
    return (
        word(data[:4], "little", signed=True),
        word(data[4:6], "little", signed=True),
        word(data[6:], "little"),
    )
