"""What the benchmarks share: folders, the exact tables, and a replay measured against them."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.base.errors import CreaseError
from crease.base.scene import Scene
from crease.lab.setup import Setup
from crease.replay.measures import Accuracy, Felt, compare, motion_m
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory

F64 = npt.NDArray[np.float64]
Exact = dict[str, F64]
"""Columns of an exact table: depth_mm; fx_mm, fy_mm, fz_mm and torque_x_mm2, ...: force and torque over stiffness."""


@dataclass(frozen=True)
class BenchSetup(Setup):
    """Folders as for the experiments; where the exact tables are, points of rivals, and whether to be quick.

    property_scenes, scenes, responses, search: of `properties`; nothing named means all.
    """

    exact: Path = Path("tests/golden/exact")
    peers: Path | None = None
    quick: bool = False
    property_scenes: Path = Path("meshes/property_scenes.toml")
    scenes: tuple[str, ...] = ()
    responses: tuple[str, ...] = ()
    search: bool = False

    def exact_of(self, path: str) -> Exact:
        """The exact table of a path, thinned out as the path is.   Errors: CreaseError."""
        file = self.exact / f"{path}.csv.gz"
        if not file.exists():
            raise CreaseError(f"{file}: is missing; name the folder of exact tables with --exact")
        return {name: column[:: self.every] for name, column in read_exact(file).items()}


def read_exact(path: Path) -> Exact:
    """Columns of an exact reference file."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",", ndmin=2)
    return dict(zip(names, rows.T, strict=True))


def box_corners(scene: Scene) -> F64:
    """Corners of the tool's box, (8, 3)."""
    low, high = np.array(list(scene.meta.tool_min_m)), np.array(list(scene.meta.tool_max_m))
    pick = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
    return np.where(pick, high, low).astype(np.float64)


def exact_force_N(exact: Exact, stiffness_N_m: float) -> F64:
    """Force of every row, (n, 3)."""
    return np.column_stack([exact[f"f{a}_mm"] for a in "xyz"]) * 1e-3 * stiffness_N_m


def exact_felt(exact: Exact, stiffness_N_m: float) -> Felt:
    """Force, depth and torque of every row."""
    torque_m2 = np.column_stack([exact[f"torque_{a}_mm2"] for a in "xyz"]) * 1e-6
    depth_m = exact["depth_mm"] * 1e-3
    return Felt(exact_force_N(exact, stiffness_N_m), depth_m, torque_m2 * stiffness_N_m)


def measure(scene: Scene, path: Trajectory, exact: Exact, options: ReplayOptions) -> Accuracy:
    """One replay against the exact table of its path."""
    rows = run_path(scene, path, options)
    felt = Felt(*(rows[name].astype(np.float64) for name in ("force_N", "depth_m", "torque_Nm")))
    return compare(
        felt,
        exact_felt(exact, options.stiffness_N_m),
        options.stiffness_N_m,
        float(scene.meta.tool_radius_m),
        motion_m(path.rows[:, 1:4], path.rows[:, 4:8], box_corners(scene)),
    )
