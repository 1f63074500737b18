"""What the benchmarks share: folders, the exact tables, and a replay measured against them."""

from __future__ import annotations

import gzip
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crease.base.errors import CreaseError
from crease.base.scene import Scene
from crease.lab.setup import Setup
from crease.replay.measures import Accuracy, Felt, amplification, compare, motion_m
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

    def exact_of(self, path: str, options: ReplayOptions) -> Exact | None:
        """The exact table of a path for a response, thinned out as the path is; None where it has none.

        Errors: CreaseError for a folder without tables.
        """
        folder = table_folder(self.exact, options)
        if not any(folder.glob("*.csv.gz")):
            raise CreaseError(f"{folder}: has no exact tables; name their folder with --exact")
        found = exact_of(self.exact, f"{path}.csv.gz", options)
        return found and {name: column[:: self.every] for name, column in found.items()}


OF_EXTENT = ("extent", "fixed45")
"""Responses that stand for the extent of the overlap. All others are judged by the way out."""


def table_folder(exact: Path, options: ReplayOptions) -> Path:
    """Where the exact tables of a response are: in `exact`, or beside it, for OF_EXTENT."""
    return exact.with_name(f"{exact.name}_extent") if options.response in OF_EXTENT else exact


def exact_of(exact: Path, file: str | None, options: ReplayOptions) -> Exact | None:
    """The exact table of a scene for a response; None where there is none."""
    path = table_folder(exact, options) / (file or "none")
    return read_exact(path) if path.exists() else None


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


def measure(
    scene: Scene, path: Trajectory, exact: Exact | None, options: ReplayOptions
) -> Accuracy:
    """One replay against the exact table of its path. Without one, NaN but for the largest amplification."""
    rows = run_path(scene, path, options)
    felt = Felt(*(rows[name].astype(np.float64) for name in ("force_N", "depth_m", "torque_Nm")))
    moved_m = motion_m(path.rows[:, 1:4], path.rows[:, 4:8], box_corners(scene))
    if exact is None:
        nan, found = math.nan, amplification(felt.force_N, options.stiffness_N_m, moved_m)
        ticks = int((felt.depth_m > 0).sum())
        return Accuracy(nan, nan, nan, nan, nan, nan, nan, nan, found, nan, nan, nan, ticks)
    return compare(
        felt,
        exact_felt(exact, options.stiffness_N_m),
        options.stiffness_N_m,
        float(scene.meta.tool_radius_m),
        moved_m,
    )
