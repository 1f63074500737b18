"""What late answers cost: the force of a board, 40 units of work a tick, beside that of ticks that have all they need.

    .venv/bin/python tests/bench/late.py [SCENE ...]      figures of TICK.md for each scene and hand, a few seconds

The paths of the golden scenes go on at one speed, which is the easiest for a search that looks ahead. So they are gone
along as a hand might: it stops and goes, goes back and forth, halts at once, trembles.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.base.scene import open_scene
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory, load_trajectory

ROOT = Path(__file__).resolve().parents[2]
UNITS = 40
"""Work a tick, as a board has it."""
WHOLE = 1 << 20
STIFFNESS_N_M = 1000.0
SCENES = (
    *("edge90_cube", "corner3_cube", "step_cube", "wall_cube", "groove_block"),
    *("bar_u", "part_spanner"),
)
HANDS = ("steady", "stop and go", "back and forth", "halts", "trembles")

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Late:
    """Of one path: force of late answers against whole ones, over stiffness."""

    rms_mm: float
    """Over ticks in contact."""
    max_mm: float
    step_mm: float
    """Largest change of a tick."""
    whole_step_mm: float
    """The same of whole answers."""
    late: float
    """Share of ticks in contact that are late."""


def along(count: int, hand: str) -> F64:
    """Where on a path of `count` ticks a hand is at each tick, in ticks.   Errors: KeyError: no such hand."""
    tick = np.arange(count, dtype=np.float64)
    second = 1e-3 * tick
    halting = np.cumsum(np.where(tick % 250 < 150, 5.0 / 3.0, 0.0))
    place = {
        "steady": tick,
        "stop and go": tick - np.sin(4.0 * np.pi * second) / (4e-3 * np.pi),
        "back and forth": 0.75 * tick + 60.0 * np.sin(6.0 * np.pi * second),
        "halts": halting,
        "trembles": 0.7 * tick,
    }[hand]
    clipped: F64 = np.clip(place, 0.0, count - 1.0)
    return clipped


def handled(rows: F64, hand: str) -> F64:
    """A path (n, 8+: time, position m, quaternion) gone along by a hand; one that trembles is 0.2 mm off at 8 to 10 Hz,
    and 2 um at random.
    """
    count = len(rows)
    at, ticks, out = along(count, hand), np.arange(count), rows.copy()
    for column in range(1, 8):
        out[:, column] = np.interp(at, ticks, rows[:, column])
    out[:, 4:8] /= np.linalg.norm(out[:, 4:8], axis=1, keepdims=True)
    if hand == "trembles":
        noise = np.random.default_rng(1).normal(0.0, 2e-6, (count, 3))
        for axis in range(3):
            out[:, 1 + axis] += (
                2e-4 * np.sin(2e-3 * np.pi * (8 + axis) * ticks + axis) + noise[:, axis]
            )
    return out


def measure(name: str, hand: str, units: int = UNITS) -> Late:
    """One scene of build/scenes along its path, by one hand.   Errors: CreaseError: not built."""
    scene = open_scene(ROOT / f"build/scenes/{name}.crs")
    steady = load_trajectory(ROOT / f"build/meshes/{name}.csv")
    path = Trajectory(handled(steady.rows, hand), steady.source)
    force_mm, late = [], np.zeros(0, bool)
    for work in (WHOLE, units):
        options = ReplayOptions(stiffness_N_m=STIFFNESS_N_M, lookups_max=work)
        rows = run_path(scene, path, options)
        force_mm.append(1e3 / STIFFNESS_N_M * rows["force_N"].astype(np.float64))
        late = rows["late_ticks"] > 0
    felt = np.linalg.norm(force_mm[0], axis=1) > 0.0
    off = np.linalg.norm(force_mm[1] - force_mm[0], axis=1)
    step = [float(np.linalg.norm(np.diff(f, axis=0), axis=1).max()) for f in force_mm]
    rms = float(np.sqrt(np.mean(off[felt] ** 2)))
    return Late(rms, float(off.max()), step[1], step[0], float(late[felt].mean()))


def main(names: list[str]) -> int:
    """Command line: see above."""
    print("| scene | hand | late | force, mm RMS / max | step, mm (whole) |\n|---|---|---|---|---|")
    for name in names or SCENES:
        for hand in HANDS:
            m = measure(name, hand)
            error = f"{m.rms_mm:.3f} / {m.max_mm:.2f}"
            step = f"{m.step_mm:.2f} ({m.whole_step_mm:.2f})"
            print(f"| {name} | {hand} | {100 * m.late:.0f} % | {error} | {step} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
