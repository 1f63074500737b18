"""What a bake will take, estimated before the work starts, and refused when it is too much."""

from __future__ import annotations

import math

import numpy as np

from crease.bake.cells import DENSE_PER_SAMPLE
from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.base.units import format_length, format_size
from crease.mesh.mesh import Mesh
from crease.mesh.topology import areas_m2

SAMPLE_BYTES = 600
"""Peak memory for each sample of a shell, and"""
POINT_BYTES = 120
"""for each fine point that its cells are gathered from. Measured: 2,600 a sample on a ball of a million, 7,850 where
triangles are little larger than a fine point."""
BRICK_BYTES = 24_000
"""Peak memory for each brick near the surface: 729 distances and facets, 512 cells, a share of finer samples."""
GRID_BYTES = 40
"""Peak memory for each brick of the whole grid: flags, the distance transform and the top level."""
BASE_BYTES = 300_000_000
"""Interpreter, libraries and both meshes."""


def shell_counts(tool: Mesh, spacing_m: float) -> tuple[float, float]:
    """About how many samples a shell has, and how many fine points they are gathered from."""
    area_m2 = areas_m2(tool.vertices_m, tool.triangles)
    points = float((np.ceil(np.sqrt(area_m2 * DENSE_PER_SAMPLE / spacing_m**2)) ** 2).sum())
    return 1.2 * float(area_m2.sum()) / spacing_m**2, points


def check_spacing(tool: Mesh, spacing_m: float, memory_max: int) -> None:
    """Errors: MeshError with the numbers when a shell of this spacing takes too much memory."""
    samples, points = shell_counts(tool, spacing_m)
    needs = BASE_BYTES + SAMPLE_BYTES * samples + POINT_BYTES * points
    if needs > memory_max:
        fits_m = spacing_m * math.sqrt((needs - BASE_BYTES) / max(memory_max - BASE_BYTES, 1e6))
        raise MeshError(
            f"{setting('spacing_m', spacing_m)} makes about {samples:,.0f} samples and takes about "
            f"{format_size(needs)}, more than {setting('memory_max_bytes', memory_max)}; "
            f"{_mend(fits_m, memory_max)}"
        )


def check_grid(static: Mesh, voxel_m: float, cells: float, memory_max: int) -> None:
    """Errors: MeshError when the grid alone takes too much memory. cells: bricks of the whole grid."""
    needs = BASE_BYTES + GRID_BYTES * cells
    if needs > memory_max:
        fits_m = voxel_m * (GRID_BYTES * cells / max(memory_max - BASE_BYTES, 1e6)) ** (1 / 3)
        raise MeshError(
            f"{static.source}: {setting('voxel_m', voxel_m)} makes a grid of {cells:,.0f} bricks and takes about "
            f"{format_size(needs)}, more than {setting('memory_max_bytes', memory_max)}; "
            f"{_mend(fits_m, memory_max)}"
        )


def check_bricks(static: Mesh, voxel_m: float, bricks: int, cells: float, memory_max: int) -> None:
    """Errors: MeshError when the bricks near the surface take too much memory."""
    needs = BASE_BYTES + GRID_BYTES * cells + BRICK_BYTES * bricks
    if needs > memory_max:
        fits_m = voxel_m * math.sqrt(needs / max(memory_max - BASE_BYTES, 1e6))
        raise MeshError(
            f"{static.source}: {setting('voxel_m', voxel_m)} makes {bricks:,} bricks near the surface and takes "
            f"about {format_size(needs)}, more than {setting('memory_max_bytes', memory_max)}; "
            f"{_mend(fits_m, memory_max)}"
        )


def _mend(fits_m: float, memory_max: int) -> str:
    """What to do: the length from which on it fits, or more memory where none does."""
    if memory_max <= BASE_BYTES:
        return f"any bake takes over {format_size(BASE_BYTES)}; allow more"
    return f"use {format_length(_up(fits_m))} or more"


def _up(value: float) -> float:
    """Two significant digits, not less than the value."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(np.ceil(value / step) * step)
