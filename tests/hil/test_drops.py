"""Frames that the kernel loses are counted, never assumed away."""

from __future__ import annotations

import socket
from itertools import count

import can
from can.interfaces.socketcan import SocketcanBus
from crease.bus.transport import kernel_drops, open_bus
from hil_tools import CHANNEL

SENT = 2000


def test_frames_lost_by_the_kernel_are_counted_to_the_frame() -> None:
    with open_bus("socketcan", CHANNEL) as sender, open_bus("socketcan", CHANNEL) as reader:
        assert isinstance(reader, SocketcanBus)
        reader.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
        assert kernel_drops(reader) == 0
        for _ in range(SENT):
            sender.send(can.Message(arbitration_id=0x191, data=bytes(8), is_extended_id=False))
        read = next(n for n in count() if reader.recv(timeout=0.0) is None)
        assert 0 < read < SENT
        assert kernel_drops(reader) == SENT - read
