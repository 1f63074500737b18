"""Opening a bus: the options -i, -c, -b of python-can's own tools, and errors on one line."""

from __future__ import annotations

import argparse
import logging
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can

from crease.base.errors import BusError
from crease.bus.dictionary import load
from crease.bus.drives import Drives, Frame

RECEIVE_BUFFER_BYTES = 4 << 20
"""SocketCAN's default of 212,992 bytes holds 278 frames, a quarter of a second's."""

POLL_S = 0.001


def add_bus_options(parser: argparse.ArgumentParser) -> None:
    """-i, -c and -b."""
    parser.add_argument(
        "-i",
        "--interface",
        metavar="NAME",
        required=True,
        help="of python-can: socketcan, virtual, slcan, ...",
    )
    parser.add_argument("-c", "--channel", metavar="NAME", required=True, help="such as vcan0")
    parser.add_argument(
        "-b",
        "--bitrate",
        metavar="BIT/S",
        type=int,
        default=None,
        help="for interfaces that set it: 1000000",
    )


def check_bitrate(bitrate: int | None) -> None:
    """Errors: BusError when it is given and not the bus's own."""
    ours = load().bus["bitrate_bit_s"]
    if bitrate is not None and bitrate != ours:
        raise BusError(f"bitrate {bitrate}: the motor bus runs at {ours}; give -b {ours}")


def _has_socketcan() -> bool:
    """Whether the kernel makes sockets of CAN."""
    import socket

    try:
        socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def check_channel(interface: str, channel: str) -> None:
    """Errors: BusError with the mend when a channel of SocketCAN is not there, or is down."""
    import socket

    if interface != "socketcan" or not channel:
        return
    head = f"socketcan {channel}: "
    if channel not in (name for _, name in socket.if_nameindex()):
        make = f"make it: sudo ip link add {channel} type vcan && sudo ip link set {channel} up"
        mend = make if channel.startswith("vcan") else "see `ip link show type can`"
        kernel = (
            ""
            if _has_socketcan()
            else "; first `sudo modprobe can_raw vcan`: this kernel has no SocketCAN"
        )
        raise BusError(f"{head}there is no such interface; {mend}{kernel}")
    try:
        socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        raise BusError(
            f"{head}no CAN socket ({error.strerror}); does this kernel have SocketCAN? sudo modprobe can_raw"
        ) from error
    flags = Path(f"/sys/class/net/{channel}/flags")
    if flags.exists() and not int(flags.read_text(), 16) & _IFF_UP:
        raise BusError(f"{head}is down; sudo ip link set {channel} up")


_IFF_UP = 1


def open_bus(interface: str, channel: str, bitrate: int | None = None, **more: Any) -> can.BusABC:
    """A python-can bus.   Errors: BusError on one line when it cannot be opened."""
    check_bitrate(bitrate)
    check_channel(interface, channel)
    options: dict[str, Any] = {} if bitrate is None else {"bitrate": bitrate}
    try:
        with _unsaid():
            bus = can.Bus(channel=channel, interface=interface, **options, **more)
    except BusError:
        raise
    except Exception as error:  # every interface of python-can raises its own kinds
        text = " ".join(str(error).split()) or type(error).__name__
        raise BusError(
            f"{interface} {channel}: cannot be opened: {text.rstrip('.')}; see python-can's page of this interface"
        ) from error
    enlarge(bus)
    return bus


@contextmanager
def _unsaid() -> Iterator[None]:
    """Within this python-can logs nothing: what is wrong is said in one line."""
    log = logging.getLogger("can")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    except BaseException as error:
        _end_half_made(error)
        raise
    finally:
        log.setLevel(level)


def _end_half_made(error: BaseException | None) -> None:
    """A half-made bus, which the frames of an error hold, ends now: python-can logs its end."""
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error = error.__context__


def enlarge(bus: can.BusABC) -> None:
    """A receive queue that survives a pause of the reader, where the interface is a socket."""
    import socket

    found = getattr(bus, "socket", None)
    if isinstance(found, socket.socket):
        force = getattr(socket, "SO_RCVBUFFORCE", 33)
        try:
            found.setsockopt(socket.SOL_SOCKET, force, RECEIVE_BUFFER_BYTES)
        except OSError:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


_SO_MEMINFO, _MEMINFO_DROPS, _MEMINFO_WORDS = 55, 8, 9


def kernel_drops(bus: can.BusABC) -> int | None:
    """Frames that the kernel threw away because the bus was not read in time, so far; None where it does not tell.

    The counter of SO_RXQ_OVFL, asked for directly: as ancillary data it would come with the next frame only, and
    python-can takes no other ancillary data than its time stamps.
    """
    import socket
    import struct

    found = getattr(bus, "socket", None)
    if not isinstance(found, socket.socket):
        return None
    try:
        words = found.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 4 * _MEMINFO_WORDS)
    except OSError:
        return None
    if len(words) < 4 * _MEMINFO_WORDS:
        return None
    return int(struct.unpack("=9I", words)[_MEMINFO_DROPS])


@contextmanager
def one_line(bus: can.BusABC) -> Iterator[None]:
    """Trouble of the interface in the block becomes a BusError on one line."""
    try:
        yield
    except (can.CanError, OSError) as error:
        raise BusError(
            f"{bus.channel_info}: the interface failed: {' '.join(str(error).split())}"
        ) from error


def now_us() -> int:
    """The monotonic clock in us."""
    return time.monotonic_ns() // 1000


def is_ours(message: can.Message) -> bool:
    """A classical data frame with an 11-bit identifier."""
    return not (
        message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd
    )


def serve(
    bus: can.BusABC, drives: Drives, stop: Callable[[], bool], duration_s: float | None = None
) -> None:
    """Run the drives on any python-can bus until `stop()` or the end of `duration_s`, by the monotonic clock."""
    end_s = None if duration_s is None else time.monotonic() + duration_s
    next_s = time.monotonic()
    while not stop() and (end_s is None or time.monotonic() < end_s):
        message = bus.recv(timeout=max(next_s - time.monotonic(), 0.0))
        if message is not None and is_ours(message):
            drives.receive(Frame(message.arbitration_id, bytes(message.data)), now_us())
        if time.monotonic() >= next_s:
            drives.poll(now_us())
            next_s = time.monotonic() + POLL_S
        for frame in drives.send():
            bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))


class ServeThread(threading.Thread):
    """The drives on a bus of their own, beside the program. Use it in a `with`."""

    def __init__(self, bus: can.BusABC, drives: Drives) -> None:
        super().__init__(daemon=True, name="crease-sim")
        self.bus, self.drives = bus, drives
        self._stop_asked = threading.Event()

    def run(self) -> None:
        """The thread."""
        serve(self.bus, self.drives, self._stop_asked.is_set)

    def __enter__(self) -> ServeThread:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_asked.set()
        self.join()
        self.bus.shutdown()
