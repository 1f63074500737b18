"""Samples of their own for voxels in which eight corners do not give the distance: halves and quarters of a voxel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crease.bake.grid import Grid, brick_points, lattice, trilinear
from crease.bake.layout import (
    CELLS_SIDE,
    FINE_BLOCKS,
    FINE_QUARTERS,
    FINE_TABLE,
    FINE_UNIT,
)

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Distance = Callable[[F64], F64]
Tick = Callable[[float], None]

HALVES, QUARTERS = 1, 2
"""Levels of a voxel: 2^level intervals a side."""
BLOCK_BYTES = np.array([0, 64, 256])
"""Of a voxel of each level in the image."""
FREE = 3
"""Level of voxels that take their distances from planes near the surface: they hold nothing back in others."""
SHARE = 0.5
"""Once a brick has a voxel that misses the tolerance, its voxels are refined down to this share of it."""
FINE_BYTES = 1_500_000
"""Blocks of more bytes together have quarters only where halves miss the tolerance itself."""
BRICKS_AT_ONCE, VOXELS_AT_ONCE = 256, 4096


@dataclass(frozen=True)
class Fine:
    """Voxels with samples of their own, in ascending order.

    Shapes: brick (n,) index among the near bricks; voxel (n,) index in the brick, x fastest; level (n,); samples
    (n, 5, 5, 5), z, y, x, in m; of those with halves every second counts.
    """

    brick: I64
    voxel: I64
    level: npt.NDArray[np.int8]
    samples: npt.NDArray[np.float32]

    @staticmethod
    def none() -> Fine:
        """No such voxels."""
        whole = np.zeros(0, np.int64)
        return Fine(whole, whole, np.zeros(0, np.int8), np.zeros((0, 5, 5, 5), np.float32))

    def of_brick(self, brick: int) -> slice:
        """Rows of a brick."""
        first, last = np.searchsorted(self.brick, [brick, brick + 1])
        return slice(int(first), int(last))


@dataclass(frozen=True)
class Coarse:
    """The near bricks with a sample at each corner of their voxels.

    Shapes: where (n, 3) brick indices x, y, z, sorted by z, y, x; phi (n, 9, 9, 9); judged (n, 8, 8, 8): voxels whose
    distances come from samples, not from planes; open (m,): bricks that keep all their samples.
    """

    grid: Grid
    where: I64
    phi: F64
    judged: Bools
    open: I64


def refine(
    coarse: Coarse,
    distance: Distance,
    tolerance_m: float,
    tick: Tick,
    found: Callable[[int], None] = lambda _count: None,
) -> Fine:
    """Voxels whose distance misses the tolerance near the surface, looked at twice a side and between.

    A brick with such a voxel has its others refined too, down to SHARE of the tolerance. Halves where these are
    enough, quarters elsewhere. Where a fine voxel meets a coarser one its samples on their
    common face are those of the coarser: the distance has no step there. tick: part of the bricks looked at, and, when
    `found` has been told how many voxels there are, of these.
    """
    marked, looked = np.zeros(coarse.judged.shape, bool), 0
    for rows in _parts(coarse.open, BRICKS_AT_ONCE):
        marked[rows] = chosen(coarse, rows, distance, tolerance_m)
        looked += len(rows)
        tick(looked / len(coarse.open))
    brick, voxel = np.nonzero(marked.reshape(len(marked), -1))
    found(len(brick))
    if len(brick) == 0:
        return Fine.none()
    samples = np.empty((len(brick), 5, 5, 5), np.float32)
    off_m = np.empty(len(brick))
    near_m = coarse.grid.near_m
    for rows in _parts(np.arange(len(brick)), VOXELS_AT_ONCE):
        points = coarse.grid.origin_m + _places(coarse.where[brick[rows]], voxel[rows]) * (
            coarse.grid.brick_m
        )
        exact = distance(points).reshape(-1, 5, 5, 5)
        samples[rows] = exact
        error = np.abs(_between(exact[:, ::2, ::2, ::2]) - exact)
        off_m[rows] = np.where(np.abs(exact) < near_m, error, 0.0).max(axis=(1, 2, 3))
        tick(float(rows[-1] + 1) / len(brick))
    fine = Fine(brick, voxel, _levels(off_m, tolerance_m), samples)
    _join(coarse, fine)
    return fine


def _levels(off_m: F64, tolerance_m: float) -> npt.NDArray[np.int8]:
    """Halves or quarters, by how far halves are off, (n,)."""
    level = np.where(off_m > SHARE * tolerance_m, QUARTERS, HALVES)
    if BLOCK_BYTES[level].sum() > FINE_BYTES:
        level = np.where(off_m > tolerance_m, QUARTERS, HALVES)
    return level.astype(np.int8)


def _parts(rows: I64, size: int) -> Iterator[I64]:
    for first in range(0, len(rows), size):
        yield rows[first : first + size]


def chosen(coarse: Coarse, rows: I64, distance: Distance, tolerance_m: float) -> Bools:
    """Judged voxels of bricks that get finer samples. (n, 8, 8, 8)."""
    judged, side = coarse.judged[rows], 2 * CELLS_SIDE
    at = lattice(side + 1)
    own = ((at * side) % 2 != 0).any(axis=1)
    nodes = _error_m(coarse, rows, at, _nodes_of(judged).reshape(len(rows), -1) & own, distance)
    nodes = nodes.reshape(len(rows), side + 1, side + 1, side + 1)
    worst = np.zeros(judged.shape)
    for z, y, x in np.ndindex(3, 3, 3):
        shifted = nodes[:, z : z + side - 1 : 2, y : y + side - 1 : 2, x : x + side - 1 : 2]
        np.maximum(worst, shifted, out=worst)
    asked = judged
    for axis in (1, 2, 3):
        asked = asked.repeat(2, axis=axis)
    inner = lattice(side, 0.5 / side, 1 - 0.5 / side)
    middles = _error_m(coarse, rows, inner, asked.reshape(len(rows), -1), distance)
    halves = (len(rows), CELLS_SIDE, 2, CELLS_SIDE, 2, CELLS_SIDE, 2)
    worst = np.where(judged, np.maximum(worst, middles.reshape(halves).max(axis=(2, 4, 6))), 0.0)
    missed = (worst > tolerance_m).any(axis=(1, 2, 3), keepdims=True)
    return np.asarray(missed & (worst > SHARE * tolerance_m))


def _error_m(coarse: Coarse, rows: I64, at: F64, asked: Bools, distance: Distance) -> F64:
    """How far samples of bricks miss the distance, 0 away from the surface. Shapes: at (m, 3), asked, result (n, m)."""
    grid = coarse.grid
    value = trilinear(coarse.phi[rows], at)
    # A mean of eight corners of a cell is no farther from the distance anywhere in it than the cell is long.
    asked = asked & (np.abs(value) < grid.near_m + math.sqrt(3.0) * grid.voxel_m)
    exact = distance(brick_points(grid, coarse.where[rows], at)[asked])
    error = np.zeros(asked.shape)
    error[asked] = np.where(np.abs(exact) < grid.near_m, np.abs(value[asked] - exact), 0.0)
    return error


def _nodes_of(voxels: Bools) -> Bools:
    """Corners, middles of edges and faces, and middles of marked voxels. (n, 8, 8, 8) to (n, 17, 17, 17)."""
    side = 2 * CELLS_SIDE + 1
    nodes = np.zeros((len(voxels), side, side, side), bool)
    for z, y, x in np.ndindex(3, 3, 3):
        nodes[:, z : z + side - 2 : 2, y : y + side - 2 : 2, x : x + side - 2 : 2] |= voxels
    return nodes


def _places(where: I64, voxel: I64) -> F64:
    """Quarters of voxels, in bricks from the grid's origin. Shapes: where (n, 3), voxel (n,); result (n, 125, 3)."""
    low = np.column_stack(
        [voxel % CELLS_SIDE, voxel // CELLS_SIDE % CELLS_SIDE, voxel // CELLS_SIDE**2]
    )
    return np.asarray(where[:, None, :] + (low[:, None, :] + lattice(5)) / CELLS_SIDE)


def _between(samples: F64) -> F64:
    """Samples of twice as many intervals a side, (n, s, s, s) to (n, 2 s - 1, ...)."""
    side = 2 * samples.shape[1] - 1
    return trilinear(samples, lattice(side)).reshape(-1, side, side, side)


def _join(coarse: Coarse, fine: Fine) -> None:
    """Take the samples of fine voxels that lie on coarser ones from those."""
    around = _levels_around(coarse, fine)
    for rows in _parts(np.arange(len(fine.brick)), VOXELS_AT_ONCE):
        least = _least(around[rows])
        exact = fine.samples[rows].astype(np.float64)
        halves = _between(exact[:, ::4, ::4, ::4])
        halves = np.where(least[:, ::2, ::2, ::2] >= HALVES, exact[:, ::2, ::2, ::2], halves)
        fine.samples[rows] = np.where(least >= QUARTERS, exact, _between(halves))


def _levels_around(coarse: Coarse, fine: Fine) -> npt.NDArray[np.int8]:
    """Levels of each fine voxel and the 26 round it, 0 where there is no brick. (n, 3, 3, 3), z, y, x."""
    level = np.where(coarse.judged, 0, FREE).astype(np.int8).reshape(len(coarse.where), -1)
    level[fine.brick, fine.voxel] = fine.level
    dims = np.array(coarse.grid.dims, np.int64)
    keys = (coarse.where[:, 2] * dims[1] + coarse.where[:, 1]) * dims[0] + coarse.where[:, 0]
    low = np.column_stack(
        [
            fine.voxel % CELLS_SIDE,
            fine.voxel // CELLS_SIDE % CELLS_SIDE,
            fine.voxel // CELLS_SIDE**2,
        ]
    )
    at = coarse.where[fine.brick] * CELLS_SIDE + low
    found = np.empty((len(at), 3, 3, 3), np.int8)
    for z, y, x in np.ndindex(3, 3, 3):
        place = at + np.array([x - 1, y - 1, z - 1])
        brick, voxel = place // CELLS_SIDE, place % CELLS_SIDE
        key = (brick[:, 2] * dims[1] + brick[:, 1]) * dims[0] + brick[:, 0]
        index = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
        value = level[index, (voxel[:, 2] * CELLS_SIDE + voxel[:, 1]) * CELLS_SIDE + voxel[:, 0]]
        found[:, z, y, x] = np.where(keys[index] == key, value, 0)
    return found


def _least(around: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """The least level of the voxels that each quarter of the middle one belongs to. (n, 3, 3, 3) to (n, 5, 5, 5)."""
    least = around
    for axis in (1, 2, 3):
        low, own, high = (np.take(least, k, axis=axis) for k in range(3))
        low, high = np.minimum(low, own), np.minimum(own, high)
        least = np.stack([low, own, own, own, high], axis=axis)
    return least


def pack_fine(
    corners: npt.NDArray[np.int16], fine: Fine, rows: slice, quantum_m: float
) -> npt.NDArray[np.int16]:
    """Samples of a fine brick as the image has them: its corners (729,), the table of its voxels, their blocks.

    Voxels with the same samples share a block, as those along a straight edge or a bore do.
    """
    table = np.zeros(CELLS_SIDE**3, np.int16)
    parts = [np.pad(corners, (0, FINE_TABLE - len(corners))), table]
    at = FINE_BLOCKS
    seen: dict[bytes, int] = {}
    values = np.clip(np.rint(fine.samples[rows] / quantum_m), -32767, 32767).astype(np.int16)
    for block, voxel, level in zip(values, fine.voxel[rows], fine.level[rows], strict=True):
        own = (block if level == QUARTERS else block[::2, ::2, ::2]).reshape(-1)
        place = seen.setdefault(own.tobytes(), at)
        table[voxel] = place // FINE_UNIT | (FINE_QUARTERS if level == QUARTERS else 0)
        if place == at:
            parts.append(np.pad(own, (0, -len(own) % FINE_UNIT)))
            at += len(parts[-1])
    return np.concatenate(parts)
