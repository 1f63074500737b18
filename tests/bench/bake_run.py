"""One `crease bake` in a process of its own, with what it cost."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from crease.base.errors import CreaseError


@dataclass(frozen=True)
class BakeRun:
    """What it printed; wall and processor time, peak resident memory, mesh loading included."""

    said: str
    wall_s: float
    cpu_s: float
    memory_MiB: float


def run_bake(*words: str | Path) -> BakeRun:
    """The words behind `crease bake`.   Errors: CreaseError with the command's own words."""
    command = [sys.executable, "-m", "crease", "bake", *map(str, words)]
    start_s = time.monotonic()
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        lines = errors.read().decode(errors="replace").strip().splitlines()
    if process.returncode != 0:
        raise CreaseError(lines[-1] if lines else f"exit status {process.returncode}")
    wall_s, cpu_s = time.monotonic() - start_s, usage.ru_utime + usage.ru_stime
    return BakeRun(said, wall_s, cpu_s, usage.ru_maxrss / 1024)
