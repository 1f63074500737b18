"""Answers of the rival libraries (query.py) against the exact tables: the points of `crease bench pareto --peers`.

    python collect.py RAW OUT.csv

Force is depth times normal, over stiffness. No amplification: the poses are thinned, and it lives in single ticks.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.replay.measures import DEEP_M, Felt, angle_deg, compare
from crease.replay.trajectory import load_trajectory

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from study.against_exact import Exact, exact_felt, read_exact  # noqa: E402
from study.points import Point, write_records  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
STIFFNESS_N_M = 1000.0


def point_of(file: Path) -> Point:
    """One library on one path; its times alone where the path has no exact table."""
    name, path = file.stem.rsplit("-", 1)
    found = np.load(file)
    table = ROOT / f"tests/golden/exact/{path}.csv.gz"
    nan = math.nan
    errors = (
        errors_of(found, path, read_exact(table))
        if table.exists()
        else Errors(found["depth_m"] > 0, nan, nan, nan, nan, nan, nan, nan, nan)
    )
    us = found["time_us"][errors.touching]
    e = errors
    print(
        f"| {path} | {name} | {np.median(us):.1f} | {us.max():.0f} | {e.force_rms_mm:.3g} | "
        f"{e.deeper_mm:+.2f} +- {e.spread_mm:.2f} | {e.turn_p50_deg:.2f} | {e.turn_p99_deg:.1f} | {e.silent:.0%} |"
    )
    return Point(
        path, "rival library", name, nan, nan, int(found["triangles"]), float(np.median(us)),
        float(us.max()), nan, 0, 0, e.force_rms_mm, e.force_max_mm, e.turn_p50_deg, e.turn_p99_deg,
        e.depth_rms_mm, nan, nan,
    )  # fmt: skip


@dataclass(frozen=True)
class Errors:
    """What a library's answers are off; `touching`: poses whose time counts."""

    touching: npt.NDArray[np.bool_]
    force_rms_mm: float
    force_max_mm: float
    depth_rms_mm: float
    deeper_mm: float
    spread_mm: float
    turn_p50_deg: float
    turn_p99_deg: float
    silent: float


def errors_of(found: Any, path: str, whole: Exact) -> Errors:
    """Answers of every so manyth pose against the exact table."""
    every = int(found["every"])
    exact = {name: column[::every] for name, column in whole.items()}
    rows = load_trajectory(ROOT / f"build/meshes/{path}.csv").rows[::every]
    force_N = STIFFNESS_N_M * found["depth_m"][:, None] * found["normal"]
    moved = np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1)
    true = exact_felt(exact, STIFFNESS_N_M)
    a = compare(Felt(force_N, found["depth_m"]), true, STIFFNESS_N_M, math.nan, moved)
    deep = np.linalg.norm(true.force_N, axis=1) > STIFFNESS_N_M * DEEP_M
    turn = angle_deg(force_N, true.force_N)[deep & force_N.any(axis=1)]
    depth_mm = 1e3 * found["depth_m"][deep] - exact["depth_mm"][deep]
    return Errors(
        exact["depth_mm"] > 0,
        a.force_rms_mm,
        a.force_max_mm,
        a.depth_rms_mm,
        float(depth_mm.mean()),
        float(depth_mm.std()),
        float(np.median(turn)) if len(turn) else math.nan,
        float(np.percentile(turn, 99)) if len(turn) else math.nan,
        1.0 - float(force_N[deep].any(axis=1).mean()),
    )


def main() -> None:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("raw", type=Path)
    parser.add_argument("out", type=Path)
    args = parser.parse_args()
    heads = ("path", "library", "query p50, us", "max, us", "force RMS, mm", "depth error, mm",
             "direction p50, deg", "p99, deg", "silent")  # fmt: skip
    print(f"| {' | '.join(heads)} |")
    print("|---|---|---|---|---|---|---|---|---|")
    write_records(args.out, [point_of(file) for file in sorted(args.raw.glob("*.npz"))])


if __name__ == "__main__":
    main()
