"""A way to answer, asked along a path: force and torque over stiffness of every tick, and steps between ticks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from crease.base.scene import Scene
from crease.replay.measures import motion_m
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation, Slerp

F64 = npt.NDArray[np.float64]
TICK_S = 1e-3

RESPONSES = (
    ("way_out", ReplayOptions()),
    ("extent", ReplayOptions(response="extent")),
    ("published", ReplayOptions(response="extent", coverage="hard")),
    *(
        (name, ReplayOptions(response=name))
        for name in (
            *("fixed45", "deepest_group", "overlap", "normal_groups", "voxmap", "distance_field"),
            *("sphere_proxy", "god_object"),
        )
    ),
)
"""What is judged by default; any other response the library has can be named too."""


@dataclass(frozen=True)
class Answer:
    """Of every tick: force / k (n, 3) in mm, torque / k about the tool's origin (n, 3) in mm^2, time in us (n,).

    A library that answers with one contact has no torque: NaN.
    `touches` (n,): whether the response looked at samples inside; times count there.
    """

    way_mm: F64
    turn_mm2: F64
    time_us: F64 = field(repr=False)
    touches: npt.NDArray[np.bool_] = field(repr=False)


Ask = Callable[[F64], Answer]
"""Poses (n, 7), mm and unit quaternions, to the answer along them, from rest."""


def asker(scene: Scene, options: ReplayOptions, repeat: int = 1) -> Ask:
    """Ask the firmware's tick."""

    def ask(poses: F64) -> Answer:
        rows = np.empty((len(poses), 8))
        rows[:, 0] = TICK_S * np.arange(len(poses))
        rows[:, 1:4], rows[:, 4:] = 1e-3 * poses[:, :3], poses[:, 3:]
        found = run_path(scene, Trajectory(rows, "made here"), options, repeat)
        k = options.stiffness_N_m
        return Answer(
            1e3 / k * found["force_N"].astype(np.float64),
            1e6 / k * found["torque_Nm"].astype(np.float64),
            1e-3 * found["tick_ns"].astype(np.float64),
            np.asarray(found["contacts"] > 0),
        )

    return ask


def poses_mm(path: Trajectory) -> F64:
    """Poses (n, 7) of a path."""
    return np.column_stack([1e3 * path.rows[:, 1:4], path.rows[:, 4:8]])


def steps_mm(poses: F64, corners_mm: F64) -> F64:
    """Largest way of any of the tool's corners (m, 3) in each tick, (n - 1,)."""
    return motion_m(poses[:, :3], poses[:, 3:], corners_mm)


def refined(poses: F64, at: npt.NDArray[np.int64], parts: int) -> tuple[F64, npt.NDArray[np.bool_]]:
    """The path with the ticks after `at` cut into `parts`; which of its steps are such parts, (m - 1,)."""
    fine = np.zeros(len(poses) - 1, dtype=np.bool_)
    fine[at] = True
    counts = np.where(fine, parts, 1)
    starts = np.repeat(np.arange(len(poses) - 1), counts)
    share = np.concatenate([np.arange(c) / c for c in counts])
    where = np.append(starts + share, len(poses) - 1.0)
    index = np.arange(len(poses), dtype=np.float64)
    out = np.empty((len(where), 7))
    for k in range(3):
        out[:, k] = np.interp(where, index, poses[:, k])
    turned = Slerp(index, Rotation.from_quat(poses[:, [4, 5, 6, 3]]))(where)
    out[:, 3:] = turned.as_quat()[:, [3, 0, 1, 2]]
    return out, np.repeat(fine, counts)
