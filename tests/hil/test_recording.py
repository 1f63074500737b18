"""What creased records on a real bus runs again to the bit; and `crease hil` over that bus."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from crease.base.native import lib
from crease.base.scene import open_scene
from crease.bus.dbc import to_dbc
from crease.bus.dictionary import load
from crease.bus.transport import open_bus
from crease.replay.recording import load_recording, rerun
from hil_tools import CHANNEL, DEVICE, closed_loop, run_creased, wait_for


def test_recording_of_creased_runs_again_to_the_bit(scene: Path, tmp_path: Path) -> None:
    record = tmp_path / "run.crr"
    with closed_loop(scene, "--seconds", "2.5", "--record", str(record)) as loop:
        text = loop.creased.communicate(timeout=20)[0]
        assert loop.creased.returncode == 0, text
        assert "0 records lost" in text
    recording = load_recording(record)
    assert len(recording) >= 2400
    again = rerun(recording, open_scene(scene))
    assert (again.records, again.different, again.gap) == (len(recording), 0, False)
    rendering = np.isin(recording.rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED))
    assert rendering.sum() > 500


def test_sigterm_stops_creased_with_zero_torque_and_status_zero(
    scene: Path, tmp_path: Path
) -> None:
    record = tmp_path / "stopped.crr"
    with closed_loop(scene, "--record", str(record)) as loop:
        loop.listen(2.0)
        loop.creased.send_signal(signal.SIGTERM)
        text = loop.creased.communicate(timeout=10)[0]
        assert loop.creased.returncode == 0, text
    rows = load_recording(record).rows
    assert (rows["target"][-3:] == 0).all()
    assert (rows["target"][:-3] != 0).any()


def test_second_host_is_refused(scene: Path) -> None:
    with closed_loop(scene) as loop:
        wait_for(loop.bus, 0x181)
        second = run_creased("--config", DEVICE, "--interface", CHANNEL, "--exit-on-fault", scene)
        assert second.returncode == 4
        assert "alien" in second.stdout


def test_bus_without_drives_is_told(scene: Path) -> None:
    said = run_creased("--config", DEVICE, "--interface", CHANNEL, "--seconds", 1.2, scene)
    assert said.returncode == 3
    assert "no answer from drive X (node 0x11) Y (node 0x12) Z (node 0x13)" in said.stderr


def test_hil_over_the_bus_turns_the_tool_as_the_path_does(scene: Path, tmp_path: Path) -> None:
    """The wrist's angles go over the bus: cantools reads them off it, and the firmware's pose follows."""
    path, record, dbc = tmp_path / "turn.csv", tmp_path / "turn.crr", tmp_path / "crease.dbc"
    yaw = np.radians(np.r_[np.linspace(0.0, 50.0, 800), np.full(200, 50.0)])
    zero = np.zeros(1000)
    columns = [np.arange(1000) * 1e-3, zero, zero, zero + 0.02, np.cos(yaw / 2), zero, zero]
    rows = np.column_stack([*columns, np.sin(yaw / 2)])
    head = "t_s,x_m,y_m,z_m,qw,qx,qy,qz"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    dbc.write_text(to_dbc(load()), encoding="ascii")
    database: Any = cantools.database.load_file(dbc)
    wrist = database.get_message_by_name("WRIST")
    words = [sys.executable, "-m", "crease", "hil", scene, "--operator", path, "-i", "socketcan"]
    command = [str(word) for word in (*words, "-c", CHANNEL, "-o", record, "--json")]
    heard = []
    with (
        open_bus("socketcan", CHANNEL) as bus,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as hil,
    ):
        while hil.poll() is None:
            if (message := bus.recv(timeout=0.5)) is not None:
                heard.append(message)
        out, err = hil.communicate()
        assert hil.returncode == 0, err
    angles = [
        wrist.decode(bytes(m.data))["yaw"] for m in heard if m.arbitration_id == wrist.frame_id
    ]
    assert json.loads(out)["faults"] == []
    assert max(angles) == pytest.approx(50.0, abs=0.051)
    states = [m for m in heard if m.arbitration_id == 0x193]
    assert len(angles) == pytest.approx(len(states) / 2, abs=1)
    told = load_recording(record).rows
    attitude = np.degrees(2 * np.arctan2(told["quaternion"][:, 3], told["quaternion"][:, 0]))
    assert attitude.max() == pytest.approx(50.0, abs=0.051)
    # The hand turns at 62.5 deg/s; two periods behind it is 0.125 deg, and one count 0.05 deg.
    start = int(np.flatnonzero(attitude > 1.0)[0])
    want = np.degrees(np.interp(np.arange(600), np.arange(1000), yaw)) + attitude[start]
    assert np.abs(attitude[start : start + 600] - want).max() < 0.25


def test_hil_over_the_bus_records_and_runs_again(scene: Path, tmp_path: Path) -> None:
    path, record = tmp_path / "path.csv", tmp_path / "hil.crr"
    z = np.r_[np.linspace(0.014, 0.008, 400), np.full(300, 0.008)]
    rows = np.column_stack([np.arange(700) * 1e-3, 0 * z, 0 * z, z, 1 + 0 * z, 0 * z, 0 * z, 0 * z])
    np.savetxt(
        path, rows, delimiter=",", header="t_s,x_m,y_m,z_m,qw,qx,qy,qz", comments="", fmt="%.9g"
    )
    words = [
        sys.executable,
        "-m",
        "crease",
        "hil",
        str(scene),
        "--operator",
        str(path),
        "-i",
        "socketcan",
        "-c",
        CHANNEL,
    ]
    said = subprocess.run(
        [*words, "-o", str(record), "--json"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert said.returncode == 0, said.stderr
    report = json.loads(said.stdout)
    assert report["faults"] == []
    assert report["ticks_in_contact"] > 300
    recording = load_recording(record)
    assert rerun(recording, open_scene(scene)).different == 0
