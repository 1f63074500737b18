"""What a tick costs: time, least of several runs of each pose; instructions, counted by valgrind."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import crease
from crease.native import COVERAGES, RESPONSES
from crease.replay import ReplayOptions, World, run_path
from crease.scene import Scene
from crease.trajectory import Trajectory

CALLGRIND_TICKS = 200
"""Poses in contact, spread over the path, whose instructions are counted."""


@dataclass(frozen=True)
class Cost:
    """Of a tick in contact. Percentiles over poses, of which each is the least of several runs."""

    p50_us: float
    p9999_us: float
    points: float
    contacts: float
    state_bytes: int
    image_bytes: int


def cost_of(scene: Scene, path: Trajectory, options: ReplayOptions, repeat: int) -> Cost:
    """Time and memory.   Errors: SceneError."""
    rows = run_path(scene, path, options, repeat=repeat)
    # Rivals may be silent where others touch: the samples say where contact is.
    touching = rows["contacts"] > 0
    touching = touching if touching.any() else np.ones(len(rows), bool)
    us = 1e-3 * rows["tick_ns"][touching]
    return Cost(
        float(np.median(us)),
        float(np.percentile(us, 99.99)),
        float(np.median(rows["points"][touching])),
        float(np.median(rows["contacts"][touching])),
        World(scene, options).size_bytes,
        len(scene.image),
    )


def counter(folder: Path) -> Path | None:
    """A program that replays a path, built for valgrind (no vectors beyond SSE2).   Output: None without the tools."""
    root = Path(crease.__file__).resolve().parents[2]
    source = root / "tests" / "check" / "replay_hash.c"
    if not (shutil.which("valgrind") and shutil.which("cc") and source.exists()):
        return None
    program = folder / "replay_hash"
    files = [source, root / "host/native/replay.c", *sorted((root / "firmware").glob("*.c"))]
    files += sorted((root / "firmware" / "rivals").glob("*.c"))
    flags = ["-std=c11", "-D_POSIX_C_SOURCE=200809L", "-DCR_RIVALS", "-O2", "-ffp-contract=off"]
    folders = [f"-I{root / name}" for name in ("firmware", "host/native")]
    done = subprocess.run(
        ["cc", *flags, "-fno-math-errno", *folders, *map(str, files), "-lm", "-o", str(program)],
        capture_output=True,
        check=False,
    )
    return program if done.returncode == 0 else None


def instructions(
    program: Path | None, scene: Scene, path: Trajectory, options: ReplayOptions
) -> float:
    """Mean instructions of a tick in contact, all skips on; NaN without valgrind.   Cost: some seconds."""
    if program is None:
        return float("nan")
    rows = run_path(scene, path, options)
    touching = np.flatnonzero(rows["contacts"] > 0)
    if not len(touching):
        return float("nan")
    # Runs of neighbouring poses: coherence between ticks is part of the cost.
    start = touching[np.linspace(0, len(touching) - 1, CALLGRIND_TICKS // 20).astype(int)]
    chosen = np.unique((start[:, None] + np.arange(20)).clip(max=len(path) - 1))
    with tempfile.TemporaryDirectory() as folder:
        image, poses = Path(folder) / "scene.crs", Path(folder) / "path.bin"
        image.write_bytes(scene.image.tobytes())
        poses.write_bytes(np.ascontiguousarray(path.rows[chosen]).tobytes())
        words = [image, poses, RESPONSES[options.response], COVERAGES[options.coverage], 7]
        done = subprocess.run(
            ["valgrind", "--tool=callgrind", "--toggle-collect=cr_tick",
             f"--callgrind-out-file={folder}/out", str(program), *map(str, words)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    found = re.search(r"Collected : (\d+)", done.stderr)
    return int(found[1]) / len(chosen) if found and done.returncode == 0 else float("nan")
