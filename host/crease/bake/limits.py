"""What a bake will take, estimated before the work starts, and refused when it is too much."""

from __future__ import annotations

import math

import numpy as np

from crease.bake.cells import DENSE_PER_SAMPLE
from crease.bake.grid import GRID_MAX, grid_cells
from crease.bake.layout import CELLS_SIDE
from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.base.units import format_length, format_size
from crease.mesh.mesh import SIZE_MAX_M, Mesh
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
BRICKS_MAX = 1_000_000
"""Near the surface, of any image."""
MARGIN = 1.25
"""A mend is for so many times the bricks that are reckoned: it must not be refused in its turn."""
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


def check_grid(static: Mesh, voxel_m: float, near_m: float, memory_max: int) -> None:
    """Errors: MeshError when the grid alone takes too much memory, or has more bricks than any may.

    near_m: distance up to which samples are covered, where half a voxel is less.
    """
    cells = grid_cells(static, voxel_m)
    needs = BASE_BYTES + GRID_BYTES * cells
    if needs > memory_max or cells > GRID_MAX:
        fits_m = _least_voxel_m(static, voxel_m, near_m, memory_max)
        raise MeshError(
            f"{static.source}: {setting('voxel_m', voxel_m)} makes a grid of {cells:,.0f} bricks and takes about "
            f"{format_size(needs)}, more than {_room(needs, memory_max, GRID_MAX)}; {_mend(fits_m, memory_max)}"
        )


def check_bricks(
    static: Mesh, voxel_m: float, near_m: float, bricks: int, cells: float, memory_max: int
) -> None:
    """Errors: MeshError when the bricks near the surface take too much memory, or are more than any image has."""
    needs = BASE_BYTES + GRID_BYTES * cells + BRICK_BYTES * bricks
    if needs > memory_max or bricks > BRICKS_MAX:
        share = bricks / _bricks(static, voxel_m, near_m)
        fits_m = _least_voxel_m(static, voxel_m, near_m, memory_max, share)
        raise MeshError(
            f"{static.source}: {setting('voxel_m', voxel_m)} makes {bricks:,} bricks near the surface and takes "
            f"about {format_size(needs)}, more than {_room(needs, memory_max, BRICKS_MAX)}; {_mend(fits_m, memory_max)}"
        )


def _room(needs: float, memory_max: int, bricks_max: int) -> str:
    return (
        setting("memory_max_bytes", memory_max) if needs > memory_max else f"{bricks_max:,} bricks"
    )


def _bricks(static: Mesh, voxel_m: float, near_m: float) -> float:
    """About how many bricks lie near the surface: those that a layer of near_m on both sides meets."""
    area_m2 = float(areas_m2(static.vertices_m, static.triangles).sum())
    brick_m = CELLS_SIDE * voxel_m
    return area_m2 * (2.0 * max(near_m, 0.5 * voxel_m) + 1.5 * brick_m) / brick_m**3


def _least_voxel_m(
    static: Mesh, voxel_m: float, near_m: float, memory_max: int, share: float = 1.0
) -> float:
    """The voxel from which on grid and bricks fit. share: bricks that were counted over those of `_bricks`."""
    share *= MARGIN
    while voxel_m < SIZE_MAX_M:
        voxel_m *= 1.02
        cells, bricks = grid_cells(static, voxel_m), share * _bricks(static, voxel_m, near_m)
        needs = BASE_BYTES + GRID_BYTES * cells + BRICK_BYTES * bricks
        if needs <= memory_max and cells <= GRID_MAX and bricks <= BRICKS_MAX:
            break
    return voxel_m


def _mend(fits_m: float, memory_max: int) -> str:
    """What to do: the length from which on it fits, or more memory where none does."""
    if memory_max <= BASE_BYTES:
        return f"any bake takes over {format_size(BASE_BYTES)}; allow more"
    return f"use {format_length(up_to_two_digits(fits_m))} or more"


def up_to_two_digits(value: float) -> float:
    """Two significant digits, not less than the value."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(np.ceil(value / step) * step)
