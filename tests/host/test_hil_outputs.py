"""What `crease hil` writes: all of it or nothing, whatever ends the run, and errors that name the file."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

import can
import numpy as np
import pytest
from crease.base import table
from host_tools import Run, write_path

COMMAND = [sys.executable, "-m", "crease", "hil"]


@pytest.fixture
def way_csv(tmp_path: Path) -> Path:
    """A short way in free space."""
    (tmp_path / "in").mkdir()
    way = np.linspace([0.0, 0.0, 0.020], [0.0, 0.0, 0.015], 50)
    return write_path(tmp_path / "in/way.csv", way)


def limited() -> None:
    """No file of this process is longer than 2 kB: as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, 2_000))


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_a_log_that_the_disk_refuses_leaves_nothing_and_is_named(
    suffix: str, tmp_path: Path, scene_crs: Path, way_csv: Path
) -> None:
    out, log = tmp_path / "out", tmp_path / "out" / f"run{suffix}"
    out.mkdir()
    log.write_bytes(b"a good old one")
    words = [scene_crs, "--operator", way_csv, "-o", out / "run.crr", "--log", log, "--force"]
    said = subprocess.run(
        [*COMMAND, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
    )
    assert said.returncode == 1
    assert said.stderr == f"error: {log}: cannot be written: {os.strerror(errno.EFBIG)}\n"
    assert log.read_bytes() == b"a good old one"
    assert list(out.iterdir()) == [log]


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_a_log_is_read_back(
    suffix: str, tmp_path: Path, scene_crs: Path, way_csv: Path, crease: Run
) -> None:
    log = tmp_path / f"run{suffix}"
    out = tmp_path / "run.crr"
    said = crease("hil", scene_crs, "--operator", way_csv, "-o", out, "--log", log, "--json")
    assert said.status == 0, said.err
    with can.LogReader(log) as frames:
        syncs = sum(frame.arbitration_id == 0x80 for frame in frames)
    assert syncs >= said.json["ticks"] - 60
    assert log.stat().st_mode == out.stat().st_mode


@pytest.mark.slow
def test_an_interrupt_leaves_the_old_log(tmp_path: Path, scene_crs: Path) -> None:
    way = write_path(tmp_path / "way.csv", np.tile([0.0, 0.0, 0.02], (200_000, 1)))
    out = tmp_path / "out"
    out.mkdir()
    log = out / "run.log"
    log.write_bytes(b"a good old one")
    words = [scene_crs, "--operator", way, "-o", out / "run.crr", "--log", log, "--force"]
    child = subprocess.Popen([*COMMAND, *map(str, words)], stderr=subprocess.PIPE)
    until_s = time.monotonic() + 60.0
    while sum(path.stat().st_size for path in out.iterdir()) < 10_000:
        assert child.poll() is None
        assert time.monotonic() < until_s
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert said.splitlines()[-1] == b"error: interrupted"
    assert log.read_bytes() == b"a good old one"
    assert list(out.iterdir()) == [log]


def test_a_table_that_the_disk_refuses_leaves_no_recording_either(
    tmp_path: Path, scene_crs: Path, way_csv: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_file: BinaryIO, _columns: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / "out"
    out.mkdir()
    words = ("hil", scene_crs, "--operator", way_csv, "-o", out / "run.crr", "--table")
    with monkeypatch.context() as patch:
        patch.setattr(table, "_write_csv", full)
        said = crease(*words, out / "run.csv", "--log", out / "run.log")
    assert said.status == 1
    assert said.err == f"error: {out / 'run.csv'}: cannot be written: No space left on device\n"
    assert list(out.iterdir()) == []
    said = crease(*words, out / "run.csv", "--log", out / "run.log")
    assert said.status == 0, said.err
    assert {path.name for path in out.iterdir()} == {"run.crr", "run.csv", "run.log"}


def test_a_fault_of_no_frame_is_refused_before_the_run(
    tmp_path: Path, scene_crs: Path, way_csv: Path, crease: Run
) -> None:
    words = ("hil", scene_crs, "--operator", way_csv, "-o", tmp_path / "run.crr")
    said = crease(*words, "--fault", "drop:tick=1500")
    assert said.status == 2
    assert "drop needs id=, such as id=0x191: see `crease bus --schedule`" in said.err
    assert not (tmp_path / "run.crr").exists()


def test_an_error_without_a_file_is_no_error_of_standard_output() -> None:
    code = (
        "import sys\nfrom crease import cli\nfrom crease.verbs import info\n"
        "def run(_): raise OSError(24, 'Too many open files')\n"
        "info.run = run\nsys.exit(cli.run_line(['info', 'any.crs']))"
    )
    command = [sys.executable, "-c", code]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (said.returncode, said.stderr) == (1, "error: Too many open files\n")
