"""The grid of bricks that the voxmap lies on, points in it, and what lies between samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import CELLS_SIDE
from crease.bake.surface import Surface
from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.mesh.mesh import Mesh

F64 = npt.NDArray[np.float64]

REACH_VOXELS = 4
"""Bricks within this many voxels of the surface hold distances; larger costs memory, smaller makes more looks."""
GRID_MAX = 200_000_000


@dataclass(frozen=True)
class Grid:
    """Brick grid. Shapes: origin_m (3,); dims x, y, z.

    near_m: up to this distance samples of the tool are covered, and distances have to be right. reach_m: bricks this
    close to the surface hold distances, so that spheres of the tool's tree can be told free.
    """

    origin_m: F64
    dims: tuple[int, int, int]
    brick_m: float
    voxel_m: float
    near_m: float
    reach_m: float


def grid_cells(mesh: Mesh, voxel_m: float) -> float:
    """About how many bricks the grid of a mesh has."""
    size = np.ptp(mesh.vertices_m, axis=0)
    return float(np.prod(size / (CELLS_SIDE * voxel_m) + 2.0 + 2.0 * REACH_VOXELS / CELLS_SIDE))


def make_grid(surface: Surface, voxel_m: float, near_m: float) -> Grid:
    """A grid whose border bricks are all farther than near_m from the surface."""
    brick = float(np.float32(voxel_m * CELLS_SIDE))
    low, high = surface.mesh.vertices_m.min(axis=0), surface.mesh.vertices_m.max(axis=0)
    reach = max(near_m, REACH_VOXELS * voxel_m)
    pad = brick + 1.01 * reach
    origin = (low - pad).astype(np.float32).astype(np.float64)
    dims = np.ceil((high + pad - origin) / brick).astype(np.int64)
    if int(np.prod(dims)) > GRID_MAX or int(dims.max()) > 65536:
        raise MeshError(
            f"{surface.mesh.source}: a voxel of {voxel_m:g} m makes {np.prod(dims):,} bricks, at most {GRID_MAX:,} fit;"
            f" use a larger {setting('voxel_m')}"
        )
    return Grid(
        origin,
        (int(dims[0]), int(dims[1]), int(dims[2])),
        brick,
        brick / CELLS_SIDE,
        near_m,
        reach,
    )


def brick_points(grid: Grid, bricks: npt.NDArray[Any], offsets: F64) -> F64:
    """Points of bricks: brick indices (n, 3) as x, y, z; offsets (m, 3) in 0..1 of a brick; result (n, m, 3)."""
    return grid.origin_m + (bricks[:, None, :] + offsets[None, :, :]) * grid.brick_m


def lattice(count: int, low: float = 0.0, high: float = 1.0) -> F64:
    """count^3 points of a cube, x fastest, (n, 3)."""
    line = np.linspace(low, high, count)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def trilinear(samples: F64, at: F64) -> F64:
    """Values of cubes of samples (n, s, s, s), indexed z, y, x, at points (m, 3) in 0..1: (n, m)."""
    side = samples.shape[1] - 1
    cell = np.minimum((at * side).astype(np.int64), side - 1)
    part = at * side - cell
    total = np.zeros((len(samples), len(at)))
    for corner in range(8):
        d = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
        weight = np.prod(np.where(d, part, 1 - part), axis=1)
        x, y, z = (cell + d).T
        total += weight * samples[:, z, y, x]
    return total
