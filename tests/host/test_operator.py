"""`crease sim --operator` and creased, as host/docs/hil.md has them: a path of the tool in the world, on a bus."""

from __future__ import annotations

import os
import re
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from crease.base.native import ffi, lib
from crease.bus import transport
from crease.bus.drives import Drives
from crease.loop.hil import operator_way
from crease.replay.recording import load_recording
from crease.replay.trajectory import load_trajectory
from crease.verbs.sim import load_path
from host_tools import Run, write_path

ROOT = Path(__file__).resolve().parents[2]
CREASED = ROOT / "build" / "gcc" / "creased-unix"
FRAME = struct.Struct("<HBx8s")
DEVICE = """[bus]
missing_max = 10
torque_timeout_ms = 0
drive_timeout_ms = 2000
host_timeout_ms = 2000
[loop]
period_us = 4000
overrun_us = 8000
deadline_us = 3500
"""


class UnixBus(can.BusABC):
    """A bus over a UNIX socket: the far end of build/gcc/creased-unix."""

    def __init__(self, path: Path) -> None:
        super().__init__(channel=str(path))
        self.channel_info = str(path)
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.listener.bind(str(path))
        self.listener.listen(1)
        self.listener.settimeout(5.0)
        self.peer: socket.socket | None = None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.peer is None:
            self.peer = self.listener.accept()[0]
        self.peer.settimeout(max(timeout or 0.0, 1e-4))
        try:
            data = self.peer.recv(FRAME.size)
        except (TimeoutError, ConnectionError):
            return None, False
        if len(data) < FRAME.size:
            time.sleep(timeout or 0.0)
            return None, False
        cob, size, content = FRAME.unpack(data)
        frame = can.Message(arbitration_id=cob, data=content[:size], is_extended_id=False)
        return frame, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        try:
            assert self.peer is not None
            self.peer.send(FRAME.pack(msg.arbitration_id, msg.dlc, bytes(msg.data)))
        except OSError:
            pass  # creased has ended


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Runs `crease sim` with options over a socket, in a thread, until it ends by itself."""
    threads: list[threading.Thread] = []

    def serve(crease: Run, *options: object) -> Path:
        path = tmp_path / "bus"
        bus = UnixBus(path)
        monkeypatch.setattr(transport, "open_bus", lambda *_: bus)
        words = ("sim", "-i", "unix", "-c", path, *options)
        threads.append(threading.Thread(target=crease, args=words, daemon=True))
        threads[-1].start()
        return path

    yield serve
    for thread in threads:
        thread.join(30.0)


@pytest.fixture(scope="module")
def into_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The ball waits above the block, comes down on it and slides, as a path of the tool in the world."""
    above = np.tile([0.0, 0.0, 0.014], (400, 1))
    down = np.linspace([0.0, 0.0, 0.014], [0.0, 0.0, 0.008], 300)
    along = np.linspace([0.0, 0.0, 0.008], [0.006, 0.0, 0.008], 200)
    return write_path(
        tmp_path_factory.mktemp("path") / "in.csv", np.concatenate([above, down, along])
    )


def test_a_path_of_the_tool_gives_the_targets_that_hil_gives(into_csv: Path) -> None:
    start_m = Drives().state.tip_pos_m
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    lead, targets = operator_way(load_trajectory(into_csv), config, start_m)
    rows = load_path(into_csv, start_m, 1e-3)
    assert (rows == np.concatenate([lead, targets])).all()
    assert np.abs(rows[0, :3] - start_m).max() < 1e-9, "from where the device stands"
    assert np.abs(np.diff(rows[:, :3], axis=0)).max() < 2.5e-3, "no jump"


def test_targets_of_the_tip_are_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "tip.csv"
    path.write_text("t_s,x_m,y_m,z_m,yaw_rad\n0,0,0.6,0,0\n0.002,0,0.6,0.002,0.2\n")
    want = [[0, 0.6, 0, 0, 0, 0], [0, 0.6, 0.001, 0.1, 0, 0], [0, 0.6, 0.002, 0.2, 0, 0]]
    assert np.allclose(load_path(path, np.zeros(3), 1e-3), want)


@pytest.mark.parametrize(
    ("head", "row", "said"),
    [
        ("t_s,x_m,y_m,z_m,qw,qx,qy,qz,yaw_rad", "0,0,0,0,1,0,0,0,0", "has yaw_rad beside the quaternion"),
        ("t_s,x_m,y_m,z_m,qw,qx,qy", "0,0,0,0,1,0,0", "qz"),
        ("t_s,x_m,y_m,z_m,qw,qx,qy,qz", "0,5,0,0,1,0,0,0", "the device does not reach this pose"),
    ],
)  # fmt: skip
def test_a_path_that_is_no_path_is_refused_in_one_line(
    tmp_path: Path, crease: Run, head: str, row: str, said: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{head}\n{row}\n")
    out = crease("sim", "-i", "virtual", "-c", "no", "--operator", path, "--seconds", "0.01")
    assert out.status == 1
    assert said in out.err
    assert out.err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.quiet
def test_sim_and_creased_render_a_path_without_a_fault(
    tmp_path: Path, scene_crs: Path, into_csv: Path, crease: Run, served: Any
) -> None:
    assert CREASED.exists(), "run make build/gcc/creased-unix"
    (tmp_path / "sim.toml").write_text("period_s = 0.004\n", encoding="ascii")
    sim = ("--device", tmp_path / "sim.toml", "--operator", into_csv)
    bus = served(crease, *sim, "--seconds", "9")
    (tmp_path / "device.toml").write_text(DEVICE, encoding="ascii")
    record = tmp_path / "run.crr"
    words = [CREASED, "--config", tmp_path / "device.toml", "--interface", bus, "--record", record]
    words += ["--start-after", "4", "--seconds", "8", scene_crs]
    said = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL, env=os.environ, timeout=60,
    )  # fmt: skip
    assert said.returncode == 0, said.stdout + said.stderr
    assert re.search(r"tick \d+: rendering\n", said.stdout), said.stdout
    rows = load_recording(record).rows
    assert not rows["faults"].any()
    pressed = rows[rows["areas"] > 0]
    assert len(pressed) > 50
    assert 0.3 < np.linalg.norm(pressed["force_N"], axis=1).max() < 4.0


@pytest.mark.slow
@pytest.mark.quiet
def test_creased_names_the_drive_and_its_error_code(
    tmp_path: Path, scene_crs: Path, into_csv: Path, crease: Run, served: Any
) -> None:
    fault = "drive_error:tick=600,axis=Y,value=0x2310"
    bus = served(crease, "--fault", fault, "--seconds", "9")
    (tmp_path / "device.toml").write_text(DEVICE, encoding="ascii")
    words = [CREASED, "--config", tmp_path / "device.toml", "--interface", bus]
    words += ["--exit-on-fault", "--seconds", "8", scene_crs]
    said = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL, timeout=60,
    )  # fmt: skip
    assert said.returncode == 4, said.stdout + said.stderr
    assert re.search(r": fault:[ a-z-]* emcy; drive Y \(node 0x12\): 0x2310\n", said.stdout), (
        said.stdout
    )
