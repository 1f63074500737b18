"""What creased records on a real bus runs again to the bit; and `crease hil` over that bus."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
from crease.native import lib
from crease.recording import load_recording, rerun
from crease.scene import open_scene
from hil_tools import CHANNEL, CREASED, DEVICE, closed_loop, wait_for


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
        command = [
            str(CREASED),
            "--config",
            str(DEVICE),
            "--interface",
            CHANNEL,
            "--exit-on-fault",
            str(scene),
        ]
        second = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
        assert second.returncode == 4
        assert "alien" in second.stdout


def test_bus_without_drives_is_told(scene: Path) -> None:
    command = [
        str(CREASED),
        "--config",
        str(DEVICE),
        "--interface",
        CHANNEL,
        "--seconds",
        "1.2",
        str(scene),
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert said.returncode == 3
    assert "no answer from drive X (node 0x11) Y (node 0x12) Z (node 0x13)" in said.stderr


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
