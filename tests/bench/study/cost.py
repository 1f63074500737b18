"""What a tick costs: time, least of several runs of each pose; instructions, counted by valgrind."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crease.base.errors import CreaseError
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World, run_path
from crease.replay.trajectory import Trajectory

from study.program import COUNTED, build_each, words_for

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


def instructions(cases: list[tuple[Scene, Trajectory, ReplayOptions]]) -> list[float]:
    """Mean instructions of a tick in contact, all skips on, for each case.

    Output: NaN where nothing touches, and everywhere without valgrind.   Errors: CreaseError when the program cannot
    be built.   Cost: some seconds a case, as many at once as there are cores.
    """
    if shutil.which("valgrind") is None:
        return [math.nan] * len(cases)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        programs = build_each(Path(folder), COUNTED, {options.response for _, _, options in cases})
        return list(pool.map(lambda case: _count(programs[case[2].response], *case), cases))


def _count(program: Path, scene: Scene, path: Trajectory, options: ReplayOptions) -> float:
    touching = np.flatnonzero(run_path(scene, path, options)["contacts"] > 0)
    if not len(touching):
        return math.nan
    # Runs of neighbouring poses: coherence between ticks is part of the cost.
    start = touching[np.linspace(0, len(touching) - 1, CALLGRIND_TICKS // 20).astype(int)]
    chosen = np.unique((start[:, None] + np.arange(20)).clip(max=len(path) - 1))
    with tempfile.TemporaryDirectory() as name:
        words = words_for(program, Path(name), scene.image, path.rows[chosen], options)
        done = subprocess.run(
            ["valgrind", "--tool=callgrind", "--toggle-collect=cr_tick", f"--callgrind-out-file={name}/out", *words],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    found = re.search(r"Collected : (\d+)", done.stderr)
    if found is None or done.returncode != 0:
        raise CreaseError(
            f"valgrind: counting {scene.source} failed: {(done.stderr.splitlines() or ['no reason'])[-1]}"
        )
    return int(found[1]) / len(chosen)
