"""`make worst`: the most expensive pose of each scene, searched for; with the work of a board's tick, and unbounded.

    python worst.py [--seconds N] [--scene NAME ...] [--write]

Random poses and those of the scene's own path are asked on this machine for the work that they count (`stats.work`);
the dearest are climbed from, first by work and then by instructions of the emulated Cortex-M7, beside the pose that was
kept. Each pose is asked out of nothing: the tool comes from far away. The search is the same each time, so far as its
time goes. --write keeps what was found in worst_poses.csv; `make check-device` measures those poses again.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np
import numpy.typing as npt
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_scene
from crease.replay.trajectory import load_trajectory
from jobs import ROOT, path_job, path_rows
from runs import CheckError, build_counter, run_device
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]

POSES = Path(__file__).with_name("worst_poses.csv")
COLUMNS = ("scene", "lookups", "instructions", *("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"))
SCENES = (
    "edge90_cube",
    "corner3_sphere",
    "corner3_cube",
    "edge60_cube",
    "wall_cube",
    "step_cube",
    "groove_block",
    "cylinder_ball",
    "bar_u",
    "part_spanner",
)
BOARD_LOOKUPS = 40
"""Of a controller that searches in its tick, as firmware/DESIGN.md has it: "A tick that fits"."""
ALL_LOOKUPS = 1 << 20
"""An answer in one tick, whatever it takes."""
TICKS = {BOARD_LOOKUPS: 24, ALL_LOOKUPS: 1}
"""Ticks that a pose is asked for."""
SLACK = 1.02
"""Another version of the compiler may take a little more."""
FAR_M = 50.0
RANDOM, KEPT, STEPS = 1500, 8, 40
"""Random poses; of all, those that are climbed from; steps of each by work."""
BATCH = 16
"""Poses of one round on the emulator."""


@dataclass(frozen=True)
class Found:
    """A pose (7,), position in m and quaternion, and what its dearest tick takes."""

    scene: str
    lookups: int
    instructions: int
    pose: F64


# ------------------------------------------------------------------------------------------------------ what poses cost


class Counted:
    """The work of ticks at poses, by this machine: a new world for each, which goes far away in the end."""

    def __init__(self, scene: Scene, lookups: int) -> None:
        """Settings: the default ones but for the work of a tick."""
        config = ffi.new("cr_config *", lib.cr_config_default())
        config.lookups_max = lookups
        size, align = int(lib.cr_world_size(scene.handle, config)), 64
        self._memory = ffi.new("char[]", size + align)
        start = int(ffi.cast("uintptr_t", self._memory))
        place = ffi.cast("void *", -(-start // align) * align)
        self._world = ffi.new("cr_world **")
        self._begin = (self._world, place, size, scene.handle, config)
        if lib.cr_world_init(*self._begin) != lib.CR_OK:
            raise CheckError(f"{scene.source}: no world of it")
        self._out, self._pose = ffi.new("cr_output *"), ffi.new("cr_pose *")
        self._ticks = TICKS[lookups]

    def _tick(self, pose: F64) -> int:
        at = self._pose
        at.pos_m.x, at.pos_m.y, at.pos_m.z = (float(v) for v in pose[:3])
        at.rot.w, at.rot.x, at.rot.y, at.rot.z = (float(v) for v in pose[3:])
        lib.cr_tick(self._world[0], at, 1e-3, self._out)
        return int(self._out.stats.work)

    def work(self, pose: F64) -> int:
        """Of the dearest tick at a pose."""
        lib.cr_world_init(*self._begin)
        most = max(self._tick(pose) for _ in range(self._ticks))
        far = np.array([FAR_M, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        return max(most, *(self._tick(far) for _ in range(self._ticks)))

    def sum(self, rows: F64) -> int:
        """Of all ticks of a path."""
        lib.cr_world_init(*self._begin)
        return sum(self._tick(row) for row in rows[:, :7])


def poses_job(scene: str, lookups: int, poses: Sequence[F64]) -> tuple[bytes, F64]:
    """A job that asks poses, and the rows of its path: of each so many ticks, and as many far away."""
    ticks = TICKS[lookups]
    far = [FAR_M, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    blocks = [np.repeat([pose, far], ticks, axis=0) for pose in poses]
    rows = np.column_stack([np.concatenate(blocks), np.full(2 * ticks * len(poses), 1e-3)])
    image = (ROOT / "build" / "scenes" / f"{scene}.crs").read_bytes()
    return path_job(image, rows.astype("<f4"), damping_Ns_m=2.0, lookups_max=lookups), rows


def instructions(scene: str, lookups: int, poses: Sequence[F64]) -> list[int]:
    """Of the dearest tick at each pose, on the emulated Cortex-M7."""
    with tempfile.TemporaryDirectory(prefix="crease-worst-") as folder:
        job = Path(folder) / "poses.job"
        job.write_bytes(poses_job(scene, lookups, poses)[0])
        run = run_device("m7", ROOT / "build" / "m7" / "replay.elf", job)
    assert run.ticks is not None
    return [int(v) for v in run.ticks[:, 0].reshape(len(poses), -1).max(axis=1)]


# ----------------------------------------------------------------------------------------------------------- the search


def random_rotation(rng: np.random.Generator) -> F64:
    """A quaternion (4,): any, or one of those that lay faces of a box flat, a little off or not."""
    q = rng.normal(size=4)
    if rng.random() < 0.5:
        q = np.where(rng.permutation(4) < rng.integers(1, 3), np.sign(q), 0.0)
        q += rng.choice([0.0, 0.0, 1e-3, 1e-2]) * rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))


def start_poses(scene: Scene, path: F64, rng: np.random.Generator) -> list[F64]:
    """Every tenth pose of the path (n, 7), and random ones near the static object."""
    low = np.array(list(scene.meta.static_min_m)) - 0.5 * scene.meta.tool_radius_m
    high = np.array(list(scene.meta.static_max_m)) + 0.5 * scene.meta.tool_radius_m
    chance = [np.r_[rng.uniform(low, high), random_rotation(rng)] for _ in range(RANDOM)]
    turned = [
        np.r_[path[rng.integers(len(path)), :3], random_rotation(rng)] for _ in range(RANDOM // 3)
    ]
    return [*path[::10], *chance, *turned]


def moved(pose: F64, size_m: float, radius_m: float, rng: np.random.Generator) -> F64:
    """A pose beside one, no point of the tool farther than about size_m."""
    turn = Rotation.from_rotvec(size_m / radius_m * rng.normal(size=3))
    turned = Rotation.from_quat(pose[3:], scalar_first=True) * turn
    shift = size_m * rng.normal(size=3) * (rng.random(3) < 0.6)
    return np.asarray(np.r_[pose[:3] + shift, turned.as_quat(scalar_first=True)])


def climb(
    start: F64, cost: Callable[[F64], int], radius_m: float, rng: np.random.Generator
) -> tuple[int, F64]:
    """Up from a pose in steps that grow where they help and shrink where they do not."""
    best, at, size_m = cost(start), start, 0.1 * radius_m
    for _ in range(STEPS):
        other = moved(at, size_m, radius_m, rng)
        found = cost(other)
        size_m = min(0.5 * radius_m, size_m * (1.5 if found > best else 0.85))
        if found >= best:
            best, at = found, other
    return best, at


def search(name: str, lookups: int, seconds: float, kept: Sequence[F64] = ()) -> Found:
    """The dearest pose that is found in this time, also from those that were kept; at least one round on the emulator.

    name: of the scene; lookups: work of a tick.
    """
    end_s = time.monotonic() + seconds
    rng = np.random.default_rng([crc32(name.encode()), lookups])
    scene = open_scene(ROOT / "build" / "scenes" / f"{name}.crs")
    path = path_rows(load_trajectory(ROOT / "build" / "meshes" / f"{name}.csv"))[:, :7]
    counted, radius_m = Counted(scene, lookups), float(scene.meta.tool_radius_m)
    starts = start_poses(scene, path.astype(np.float64), rng)
    ranked = sorted(starts, key=counted.work, reverse=True)
    climbed = [climb(pose, counted.work, radius_m, rng) for pose in ranked[:KEPT]]
    tops = [pose for _, pose in sorted(climbed, key=lambda c: c[0], reverse=True)]
    poses = [*kept, *tops, *ranked[: BATCH - len(tops) - len(kept)]]
    costs = instructions(name, lookups, poses)
    size_m = 0.05 * radius_m
    while time.monotonic() < end_s and size_m > 1e-6:
        best = [poses[i] for i in np.argsort(costs)[::-1][:4]]
        others = [moved(best[i % 4], size_m, radius_m, rng) for i in range(BATCH)]
        found = instructions(name, lookups, others)
        size_m *= 1.3 if max(found) > max(costs) else 0.7
        poses, costs = [*poses, *others], [*costs, *found]
    at = int(np.argmax(costs))
    best_pose = poses[at].astype(np.float32).astype(np.float64)
    return Found(name, lookups, instructions(name, lookups, [best_pose])[0], best_pose)


# ------------------------------------------------------------------------------------------------------- what was found


def read_poses(file: Path = POSES) -> list[Found]:
    """The poses that were found."""
    with file.open(encoding="ascii", newline="") as text:
        return [
            Found(
                row["scene"],
                int(row["lookups"]),
                int(row["instructions"]),
                np.array([float(row[name]) for name in COLUMNS[3:]]),
            )
            for row in csv.DictReader(text)
        ]


def write_poses(found: Iterable[Found], file: Path = POSES) -> None:
    """For the times to come."""
    with file.open("w", encoding="ascii", newline="") as text:
        table = csv.writer(text, lineterminator="\n")
        table.writerow(COLUMNS)
        for f in found:
            numbers = (f"{v:.9g}" for v in f.pose)
            table.writerow([f.scene, f.lookups, f.instructions, *numbers])


def measure(known: Sequence[Found]) -> list[int]:
    """Instructions of poses that were found, today."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda f: instructions(f.scene, f.lookups, [f.pose])[0], known))


def dearer(known: Sequence[Found], costs: Sequence[int]) -> list[str]:
    """A line for each pose that takes more than when it was found."""
    return [
        f"m7: {f.scene}, {f.lookups} lookups: its worst pose takes {cost:,} instructions, not {f.instructions:,}"
        for f, cost in zip(known, costs, strict=True)
        if cost > SLACK * f.instructions
    ]


def main() -> int:
    """Command line: see above."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=30.0, help="of each search (30)")
    parser.add_argument("--scene", action="append", choices=SCENES, help="these alone")
    parser.add_argument("--write", action="store_true", help=f"keep them in {POSES.name}")
    args = parser.parse_args()
    if args.write and args.scene:
        parser.error("--write is for all scenes")
    try:
        build_counter()
        found = []
        print(f"{'scene':16}{'lookups':>10}{'instructions':>15}{'kept before':>14}")
        before = {(f.scene, f.lookups): f for f in read_poses()}
        for name in args.scene or SCENES:
            for lookups in TICKS:
                known = before.get((name, lookups))
                kept = [known.pose] if known else []
                found.append(search(name, lookups, args.seconds, kept))
                told = known.instructions if known else 0
                print(f"{name:16}{lookups:10,}{found[-1].instructions:15,}{told:14,}", flush=True)
    except CheckError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if args.write:
        write_poses(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
