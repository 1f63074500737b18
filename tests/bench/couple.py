"""Time of the tick with a held tool: percentiles over the ticks in contact of a few scenes.

    python tests/bench/couple.py [--scene NAME] [--repeat N]

Each path is run several times, and the least time of each tick counts, so that the machine's other work does not.
Looked: lookups of 16 points in a tick, median and p99; planes: those of near samples at its end.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import manifold3d as mf
import numpy as np
import numpy.typing as npt
from crease import Scene, bake, make_mesh
from crease.replay.replay import CoupleOptions, ReplayOptions, run_path
from crease.replay.trajectory import Trajectory, check_rows
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]
SEGMENTS = 96
PLAY_MM, ERROR_MM, ERROR_DEG = 0.4, 2.0, 2.0


def box(x: float, y: float, z: float) -> Any:
    """About the origin, mm."""
    return mf.Manifold.cube([x, y, z], True)


def cylinder(height: float, low: float, high: float) -> Any:
    """On z = 0, radii at both ends, mm."""
    return mf.Manifold.cylinder(height, low, high, SEGMENTS)


def hole(play_mm: float) -> Any:
    """A block whose top is z = 0, with a hole of 20 mm and the play, 3 mm chamfer, 35 mm deep."""
    radius = 10.0 + 0.5 * play_mm
    empty = cylinder(35, radius, radius).translate([0, 0, -35])
    rim = cylinder(3.1, radius, radius + 3.1).translate([0, 0, -3])
    return box(60, 60, 45).translate([0, 0, -22.5]) - (empty + rim)


def peg() -> Any:
    """20 mm wide, 40 mm long, its lower end at the origin."""
    return cylinder(40, 10, 10)


def scene_of(static: Any, tool: Any, spacing_mm: float, voxel_mm: float) -> Scene:
    """Baked."""
    meshes = [
        make_mesh(
            np.asarray(s.to_mesh().vert_properties[:, :3], float), s.to_mesh().tri_verts, 1e-3
        )
        for s in (static, tool)
    ]
    return bake(*meshes, spacing_m=1e-3 * spacing_mm, voxel_m=1e-3 * voxel_mm)


def path_of(at_mm: F64, turns: Rotation) -> Trajectory:
    """One pose a millisecond."""
    x, y, z, w = turns.as_quat().T
    rows = np.column_stack([1e-3 * np.arange(len(at_mm)), 1e-3 * at_mm, w, x, y, z])
    return check_rows(rows, "path")


def wander(rng: np.random.Generator, seconds: npt.NDArray[np.floating[Any]], size: int) -> F64:
    """A smooth way (n, size) between -1 and 1: three sines of 0.3 to 2 Hz each."""
    rate, phase = rng.uniform(2, 12, (3, size)), rng.uniform(0, 2 * np.pi, (3, size))
    waves = np.sin(seconds[:, np.newaxis, np.newaxis] * rate + phase)
    return np.asarray(waves.mean(axis=1), dtype=np.float64)


def peg_path(seed: int, down_mm: float = 30.0, ticks: int = 2000) -> Trajectory:
    """Down into the hole by a hand that errs by 2 mm and 2 degrees."""
    rng, seconds = np.random.default_rng(seed), 1e-3 * np.arange(ticks)
    at_mm = ERROR_MM * wander(rng, seconds, 3)
    at_mm[:, 2] = np.linspace(3.0, -down_mm, ticks)
    return path_of(at_mm, Rotation.from_rotvec(np.radians(ERROR_DEG) * wander(rng, seconds, 3)))


def edges_path() -> Trajectory:
    """A cylinder that lies, turned in plan, drawn over the top of a cube and its edges, 2 mm deep."""
    along = np.linspace(-45, 45, 2000)
    at_mm = np.column_stack([along, 3 * np.sin(along / 7), np.full(len(along), 38.0)])
    lean = np.column_stack(
        [0.1 * np.sin(along / 5), np.full(len(along), 0.02), 0.3 * np.sin(along / 9)]
    )
    return path_of(at_mm, Rotation.from_rotvec(lean) * Rotation.from_rotvec([np.pi / 2, 0, 0]))


def face_path(half_mm: float) -> Trajectory:
    """A cube set down on its face, pushed about and turned there."""
    a = np.linspace(0, 2 * np.pi, 2000)
    at_mm = np.column_stack(
        [8 * np.sin(a), 5 * np.sin(2 * a), half_mm + 1 - 3 * np.sin(a / 2) ** 2]
    )
    lean = np.column_stack([0.03 * np.sin(3 * a), 0.03 * np.sin(2 * a), 0.3 * np.sin(a)])
    return path_of(at_mm, Rotation.from_rotvec(lean))


def stroke_path() -> Trajectory:
    """A cube on a corner, 0.5 m/s, to 8 mm below a plate's top, then drawn along it."""
    down = np.arange(22, 8, -0.5)
    along = np.linspace(0, 15, 500)
    at_mm = np.column_stack(
        [np.r_[0 * down, along], np.r_[0 * down, 0 * along], np.r_[down, 8 + 0 * along]]
    )
    turn = Rotation.from_rotvec([0.5, 0.4, 0.1]).as_quat()
    return path_of(at_mm, Rotation.from_quat(np.tile(turn, (len(at_mm), 1))))


@dataclass(frozen=True)
class Case:
    """A scene, and paths in it."""

    scene: Callable[[], Scene]
    paths: Callable[[], list[Trajectory]]


CASES = {
    "peg": Case(
        lambda: scene_of(hole(PLAY_MM), peg(), 1.4, 1.0), lambda: [peg_path(k) for k in range(5)]
    ),
    "edges": Case(
        lambda: scene_of(box(60, 60, 60), cylinder(60, 10, 10).translate([0, 0, -30]), 2.0, 1.0),
        lambda: [edges_path()],
    ),
    "plate": Case(
        lambda: scene_of(box(60, 60, 1), box(20, 20, 20), 2.0, 1.0), lambda: [stroke_path()]
    ),
    "face": Case(
        lambda: scene_of(box(90, 90, 20).translate([0, 0, -10]), box(60, 60, 60), 2.0, 2.0),
        lambda: [face_path(30)],
    ),
}


def measure(name: str, repeat: int, friction: float) -> str:
    """One line of the table."""
    case = CASES[name]
    scene = case.scene()
    options = ReplayOptions(2000.0, couple=CoupleOptions(friction=friction))
    rows = np.concatenate([run_path(scene, path, options, repeat=repeat) for path in case.paths()])
    assert not rows["faults"].any()
    held = rows[rows["areas"] > 0]
    us = np.percentile(1e-3 * held["tick_ns"], [50, 99, 100])
    looked = np.percentile(held["nodes"], [50, 99])
    planes = np.percentile(held["points"], 50)
    return (
        f"{name:8} {scene.meta.point_count:7d} {len(held):6d} {us[0]:8.1f} {us[1]:8.1f} {us[2]:8.1f} "
        f"{looked[0]:8.0f} {looked[1]:8.0f} {planes:7.0f}"
    )


def main() -> None:
    """Command line: see above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--scene", choices=sorted(CASES))
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--friction", type=float, default=0.0)
    args = parser.parse_args()
    print("scene    samples  ticks   p50 us   p99 us   max us  looked     p99  planes")
    for name in [args.scene] if args.scene else CASES:
        print(measure(name, args.repeat, args.friction), flush=True)


if __name__ == "__main__":
    main()
