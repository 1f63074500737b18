"""A python-can bus with the simulated drives behind it, in lock-step: `can.Bus(interface="inprocess", channel=NAME)`.

Every bus of the same channel hears the others and the same drives. A SYNC moves time by one period, any other frame by
none, so that a program that sends the same frames hears the same answers, whatever the machine does meanwhile.
"""

from __future__ import annotations

import queue
import threading
from typing import Any

import can

from crease.base.errors import BusError
from crease.bus.drives import Drives, Frame

PERIOD_US = 1000
SYNC = 0x080


class _Channel:
    """The drives, the time, and who listens."""

    def __init__(self, drives: Drives) -> None:
        self.drives = drives
        self.now_us = 0
        self.buses: list[InprocessBus] = []
        self.lock = threading.RLock()

    def put(self, frame: Frame, sender: InprocessBus | None) -> None:
        """Hand a frame to every bus but the sender's own."""
        message = can.Message(
            arbitration_id=frame.id,
            data=frame.data,
            is_extended_id=False,
            timestamp=self.now_us * 1e-6,
        )
        for bus in self.buses:
            if bus is not sender or bus.receive_own_messages:
                bus.frames.put(message)

    def send(self, frame: Frame, sender: InprocessBus) -> None:
        """One frame of a bus to all, then what the drives answer."""
        with self.lock:
            if frame.id == SYNC:
                self.now_us += PERIOD_US
            self.put(frame, sender)
            self.drives.receive(frame, self.now_us)
            self.drives.poll(self.now_us)
            for answer in self.drives.send():
                self.put(answer, None)


_CHANNELS: dict[str, _Channel] = {}


def prepare(channel: str, drives: Drives) -> None:
    """Let the next buses of `channel` have these drives behind them."""
    _CHANNELS[channel] = _Channel(drives)


def drives_of(channel: str) -> Drives:
    """The drives of a channel.   Errors: BusError when nobody opened it."""
    if channel not in _CHANNELS:
        raise BusError(f"channel '{channel}' is not open; open a bus on it first")
    return _CHANNELS[channel].drives


class InprocessBus(can.BusABC):
    """One end of an in-process bus. `receive_own_messages` as with other interfaces of python-can."""

    def __init__(
        self, channel: str = "inprocess", receive_own_messages: bool = False, **kwargs: Any
    ) -> None:
        self.receive_own_messages = receive_own_messages
        self.frames: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
        self.channel_info = f"inprocess:{channel}"
        self._channel = _CHANNELS.setdefault(channel, _Channel(Drives()))
        super().__init__(channel=channel, **kwargs)
        with self._channel.lock:
            self._channel.buses.append(self)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Errors: can.CanOperationError for anything but a classical data frame with an 11-bit identifier."""
        if msg.is_extended_id or msg.is_remote_frame or msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError(
                "the motor bus has classical data frames with 11-bit identifiers only"
            )
        self._channel.send(Frame(msg.arbitration_id, bytes(msg.data)), self)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            return self.frames.get(block=timeout != 0, timeout=timeout), False
        except queue.Empty:
            return None, False

    def shutdown(self) -> None:
        """Leave the channel; the last one to leave takes the drives along."""
        super().shutdown()
        with self._channel.lock:
            if self in self._channel.buses:
                self._channel.buses.remove(self)
            if not self._channel.buses:
                for name, channel in list(_CHANNELS.items()):
                    if channel is self._channel:
                        del _CHANNELS[name]
