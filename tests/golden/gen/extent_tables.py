"""Exact extent of the overlap in every scene, what the contact-zone method stands for, from mesh booleans.

    python tests/golden/gen/extent_tables.py SCENE|all [--every N] [--skip SCENE] [-o DIR]

Reads meshes/scenes.toml and build/meshes (made by meshes/make.py), writes
tests/golden/exact_extent/NAME.csv.gz: the same bytes on every run. Definitions and columns: README.md
beside this file. With --every N only the ticks i, i + 1 with i divisible by N are computed (pairs,
so that steps per tick can still be measured).
"""

from __future__ import annotations

import argparse
import gzip
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from overlap import Contact, Solid, contact, make_solid, read_stl
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[3]
Floats = NDArray[np.float64]
Solve = Callable[[dict[str, Any], Path, int], tuple[Floats, str]]
"""Scene, folder of meshes, every: rows (n, 13), summary line."""

COLUMNS = (
    "t_s,fx_mm,fy_mm,fz_mm,depth_mm,nx,ny,nz,areas,volume_mm3,"
    "torque_x_mm2,torque_y_mm2,torque_z_mm2"
)
# Directions are compared only where the contact is deeper than this (mm), as in the measures of the
# project.
DEEP_MM = 0.2


@dataclass(frozen=True)
class Trace:
    """A tool path: time (n,) s, position (n, 3) mm, attitude of length n."""

    t_s: Floats
    position_mm: Floats
    attitude: Rotation


def read_path(path: Path) -> Trace:
    """Trajectory CSV t_s, x_m, y_m, z_m, qw, qx, qy, qz."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    return Trace(rows[:, 0], rows[:, 1:4] * 1000.0, Rotation.from_quat(rows[:, [5, 6, 7, 4]]))


def row_of(found: Contact, t_s: float, origin_mm: Floats) -> Floats:
    """One line of the table, (13,), in the order of COLUMNS."""
    depth, normal = 0.0, np.zeros(3)
    for area in found.areas:
        if area.depth_mm > depth:
            depth, normal = area.depth_mm, area.normal
    torque = found.torque_mm2(origin_mm)
    head = [t_s, *found.force_mm(), depth, *normal, len(found.areas), found.volume_mm3]
    return np.array([*head, *torque], float)


def table_bytes(rows: Floats) -> bytes:
    """CSV of the rows (n, 13), compressed without a time stamp."""
    lines = [COLUMNS]
    for row in rows + 0.0:
        cells = [f"{row[0]:.3f}", *(f"{v:.6f}" for v in row[1:8]), f"{int(row[8])}"]
        lines.append(
            ",".join([*cells, *(f"{v:.5f}" for v in row[9:])]).replace("-0.000000", "0.000000")
        )
    return gzip.compress(("\n".join(lines) + "\n").encode(), 9, mtime=0)


def summary(rows: Floats, trace: Trace, ticks: NDArray[np.int64], tool: Solid) -> str:
    """Range of depth, largest direction step and force amplification over consecutive ticks."""
    pair = np.flatnonzero(np.diff(ticks) == 1)
    force, deep = rows[:, 1:4], rows[:, 4] > DEEP_MM
    moved = np.array([_largest_move(trace, int(ticks[i]), tool.vertices) for i in pair])
    change = np.linalg.norm(force[pair + 1] - force[pair], axis=1)
    stiff = change / np.maximum(moved, 1e-6)
    size = np.linalg.norm(force, axis=1)
    both = deep[pair] & deep[pair + 1] & (size[pair] > DEEP_MM) & (size[pair + 1] > DEEP_MM)
    a, b = force[pair], force[pair + 1]
    turn = np.degrees(
        np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    )
    turn = np.where(both, turn, 0.0)
    worst, most = int(np.argmax(turn)), int(np.argmax(stiff))
    return (
        f"{len(ticks)} ticks, {int((rows[:, 4] > 0).sum())} in contact,"
        f" depth max {rows[:, 4].max():.3f} mm, areas max {int(rows[:, 8].max())},"
        f" direction step max {turn[worst]:.3f} deg (tick {ticks[pair[worst]]}),"
        f" amplification max {stiff[most]:.3f} (tick {ticks[pair[most]]})"
    )


def _largest_move(trace: Trace, tick: int, vertices: Floats) -> float:
    """Largest displacement (mm) of any tool point to the next tick: convex, so a vertex has it."""
    before = trace.attitude[tick].apply(vertices) + trace.position_mm[tick]
    after = trace.attitude[tick + 1].apply(vertices) + trace.position_mm[tick + 1]
    return float(np.linalg.norm(after - before, axis=1).max())


def chosen_ticks(trace: Trace, every: int) -> NDArray[np.int64]:
    """Ticks i, i + 1 with i divisible by `every`."""
    ticks = np.arange(len(trace.t_s))
    return np.asarray(ticks[(ticks % every == 0) | (ticks % every == 1)])


def solve_scene(scene: dict[str, Any], meshes: Path, every: int) -> tuple[Floats, str]:
    """Rows (n, 13) of one scene and its summary line."""
    static = make_solid(*read_stl(meshes / scene["static"]))
    tool = make_solid(*read_stl(meshes / scene["tool"]))
    trace = read_path(meshes / scene["path"])
    ticks = chosen_ticks(trace, every)
    matrix = trace.attitude.as_matrix()
    rows = []
    imbalance = 0.0
    for i in ticks:
        found = contact(static, tool, matrix[i], trace.position_mm[i])
        imbalance = max(imbalance, found.imbalance)
        rows.append(row_of(found, float(trace.t_s[i]), trace.position_mm[i]))
    table = np.array(rows)
    return table, f"{summary(table, trace, ticks, tool)}, normal sums agree to {imbalance:.1e}"


def write_tables(about: str, folder: str, solve: Solve) -> None:
    """Command line of a reference: the scenes that it names, solved, each a file of tests/golden/`folder`."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("scene", help="name in meshes/scenes.toml, or 'all'")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="pairs of ticks, every N")
    parser.add_argument("--skip", action="append", default=[], metavar="SCENE")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "tests" / "golden" / folder)
    args = parser.parse_args()
    scenes = tomllib.loads((ROOT / "meshes" / "scenes.toml").read_text())
    if args.scene != "all" and args.scene not in scenes:
        parser.error(f"unknown scene {args.scene}; known: {' '.join(scenes)}")
    args.out.mkdir(parents=True, exist_ok=True)
    done: set[str] = set()
    for name, scene in scenes.items():
        if args.scene not in ("all", name) or name in args.skip or scene["exact"] in done:
            continue
        done.add(scene["exact"])
        begin = time.perf_counter()
        rows, text = solve(scene, ROOT / "build" / "meshes", args.every)
        target = args.out / scene["exact"]
        part = target.with_name(target.name + ".part")
        part.write_bytes(table_bytes(rows))
        part.replace(target)
        print(f"{name}: {text}, {time.perf_counter() - begin:.1f} s", flush=True)


if __name__ == "__main__":
    write_tables(
        "Exact extent of the overlap in the test scenes, from mesh booleans.",
        "exact_extent",
        solve_scene,
    )
