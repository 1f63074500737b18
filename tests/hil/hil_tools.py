"""The firmware and the simulated drives as two processes on vcan0, and a log of what they said."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import can
from crease.bus.transport import open_bus

ROOT = Path(__file__).resolve().parents[2]
CREASED = ROOT / "build" / "gcc" / "creased"
DEVICE = ROOT / "firmware" / "port" / "linux" / "device.toml"
CHANNEL = "vcan0"
NODES = (0x11, 0x12, 0x13)

Frame = tuple[float, int, bytes]
"""Time s (of the kernel's stamp), identifier, data."""


def run_creased(*words: object) -> subprocess.CompletedProcess[str]:
    """`creased` with these words, to its end."""
    command = [str(word) for word in (CREASED, *words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


@dataclass
class Loop:
    """Both ends and a listener."""

    sim: subprocess.Popen[str]
    creased: subprocess.Popen[str]
    bus: can.BusABC

    def listen(self, seconds: float) -> list[Frame]:
        """What goes over the bus meanwhile."""
        heard: list[Frame] = []
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            if (message := self.bus.recv(timeout=left_s)) is not None:
                heard.append((message.timestamp, message.arbitration_id, bytes(message.data)))
        return heard


def bake_scene(folder: Path) -> Path:
    """A ball against a block, small and quick to bake."""
    import trimesh
    from crease.cli import main

    trimesh.creation.box(bounds=[[-40, -40, -40], [40, 40, 0]]).export(folder / "block.stl")
    trimesh.creation.icosphere(subdivisions=3, radius=10.0).export(folder / "ball.stl")
    path = folder / "scene.crs"
    words = [
        "bake",
        folder / "block.stl",
        folder / "ball.stl",
        "-o",
        path,
        "--unit",
        "mm",
        "--spacing",
        "2mm",
        "--memory-max",
        "1GiB",  # the little kernel has less, and this takes less than estimated
    ]
    assert main([str(word) for word in words]) == 0
    return path


def wait_for(bus: can.BusABC, cob: int, seconds: float = 30.0) -> None:
    """Until a frame with this identifier comes.   Errors: AssertionError."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        message = bus.recv(timeout=0.1)
        if message is not None and message.arbitration_id == cob:
            return
    raise AssertionError(f"no frame 0x{cob:03X} within {seconds} s")


@contextmanager
def closed_loop(scene: Path, *options: str) -> Iterator[Loop]:
    """`crease sim` and creased on vcan0. What still runs at the end is ended."""
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus("socketcan", CHANNEL))
        words = [sys.executable, "-m", "crease", "sim", "-i", "socketcan", "-c", CHANNEL, "--json"]
        sim = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        stack.callback(_end, sim)
        wait_for(bus, 0x713)
        words = [
            str(CREASED),
            "--config",
            str(DEVICE),
            "--interface",
            CHANNEL,
            "--start",
            *options,
            str(scene),
        ]
        creased = stack.enter_context(
            subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        )
        stack.callback(_end, creased)
        yield Loop(sim, creased, bus)


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()


def of(frames: list[Frame], cob: int) -> list[tuple[float, bytes]]:
    """Time and data of the frames with one identifier."""
    return [(time_s, data) for time_s, found, data in frames if found == cob]


def late_syncs(frames: list[Frame], slack_s: float = 5e-5) -> int:
    """SYNC frames that did not come one period after the one before."""
    times = [time_s for time_s, _ in of(frames, 0x080)]
    return sum(abs(b - a - 1e-3) > slack_s for a, b in pairwise(times))


def torques_of(data: bytes) -> list[int]:
    """The three words of a torque frame."""
    return [int.from_bytes(data[i : i + 2], "little", signed=True) for i in (0, 2, 4)]


def enabled(data: bytes) -> bool:
    """A state frame says operation enabled."""
    return int.from_bytes(data[6:], "little") & 0x6F == 0x27
