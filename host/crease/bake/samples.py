"""The samples of a tool: those of its faces and those of what sticks out, before they are grouped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crease.bake.cells import FLAT, Cells, make_cells
from crease.bake.features import Features, feature_points
from crease.bake.surface import Surface
from crease.bake.vectors import F64, I64, unit

FEATURE_AREA = 1e-3
"""Area of a vertex or crease sample as a share of spacing^2: gives a lone spike a direction, shifts no sum."""


VERTEX_RADIUS, VERTEX_SLOPE_MAX = 0.25, 0.3
"""Disc that a vertex of a smooth surface stands for, as a share of the spacing; steeper ones are corners: points."""


WIDE = 1.82
"""Ramps from its middle up to which a piece amid a flat face is taken to reach: CR_WAY_REACH of firmware/contact."""
CHUNK = 20_000
"""Pieces whose neighbours are asked for at once."""


@dataclass(frozen=True)
class Samples:
    """Shapes: position_m, area_m2 (vectors, outward), normal (n, 3); spread_m2 (n, 3, 3); the others (n,).

    inner: pieces of a flat face that ends nowhere near them.
    """

    position_m: F64
    area_m2: F64
    normal: F64
    spread_m2: F64
    ramp_m: F64
    reach_m: F64
    bow_m: F64
    feature: npt.NDArray[np.bool_]
    crease: npt.NDArray[np.bool_]
    vertex: npt.NDArray[np.bool_]
    inner: npt.NDArray[np.bool_]
    patch: I64


def make_samples(
    surface: Surface,
    spacing_m: float,
    tick: Callable[[float], None] = lambda _part: None,
    even: bool = False,
) -> Samples:
    """The shell before grouping; even: see make_cells."""
    cells = make_cells(surface, spacing_m, tick, even)
    position, count = cells.position_m, len(cells.position_m)
    spots = feature_points(surface, spacing_m)
    spot_area = FEATURE_AREA * spacing_m**2 * spots.normal
    some = len(spots.position_m) > 0
    spot_patch = (
        cells.patch[cKDTree(position).query(spots.position_m)[1]] if some else np.zeros(0, np.int64)
    )
    # The closed surface's area vectors add up to zero; the features' little areas must not spoil that.
    area = cells.area_m2 - (cells.area_m2.sum(axis=0) + spot_area.sum(axis=0)) / count
    # A vertex of a smooth surface stands for a disc round it, over which the faces fall away.
    smooth = (spots.slope > 0) & (spots.slope < VERTEX_SLOPE_MAX)
    radius = np.where(smooth, VERTEX_RADIUS * spacing_m, 0.0)
    across = np.eye(3) - spots.normal[:, :, None] * spots.normal[:, None, :]
    spread = np.concatenate(
        [
            cells.spread_m2,
            spots.half_m[:, :, None] * spots.half_m[:, None, :] / 3
            + radius[:, None, None] ** 2 / 3 * across,
        ]
    )
    # A uniform strip of width b has the second moment b^2 / 12.
    widest = np.sqrt(np.maximum(0.0, 12 * np.linalg.eigvalsh(spread)[:, -1]))
    half = np.linalg.norm(spots.half_m, axis=1)
    ramp = 0.5 * np.maximum(widest, 0.1 * spacing_m)
    return Samples(
        np.concatenate([position, spots.position_m]),
        np.concatenate([area, spot_area]),
        np.concatenate([unit(area), spots.normal]),
        spread,
        ramp,
        np.concatenate([np.zeros(count), half]),
        np.concatenate([cells.bow_m, radius * spots.slope]),
        np.arange(count + len(spot_area)) >= count,
        np.concatenate([np.zeros(count, bool), half > 0]),
        np.concatenate([np.zeros(count, bool), half == 0]),
        np.concatenate(
            [_inner(cells, unit(area), ramp[:count], spots, spacing_m), np.zeros(len(half), bool)]
        ),
        np.concatenate([cells.patch, spot_patch]),
    )


def _inner(
    cells: Cells, normal: F64, ramp_m: F64, spots: Features, spacing_m: float
) -> npt.NDArray[np.bool_]:
    """Flat pieces round which the face goes on: no crease, nor a piece that bends or lies askew, within WIDE ramps.

    Shapes: normal (n, 3), ramp_m (n,) of the cells; result (n,).
    """
    inner = cells.bow_m <= 0.0
    all_cells, all_spots = cKDTree(cells.position_m), cKDTree(spots.position_m.reshape(-1, 3))
    half_m = np.linalg.norm(spots.half_m, axis=1)
    flat = np.flatnonzero(inner)
    for rows in np.split(flat, range(CHUNK, len(flat), CHUNK)):
        wide_m, tree = WIDE * ramp_m[rows], cKDTree(cells.position_m[rows].reshape(-1, 3))

        def near(
            others: cKDTree, radius_m: F64, tree: cKDTree = tree, wide_m: F64 = wide_m
        ) -> tuple[I64, I64]:
            reach_m = wide_m.max(initial=0.0) + radius_m.max(initial=0.0)
            found = tree.sparse_distance_matrix(others, reach_m, output_type="ndarray")
            found = found[found["v"] < wide_m[found["i"]] + radius_m[found["j"]]]
            return found["i"], found["j"]

        mine, other = near(all_cells, ramp_m)
        way = cells.position_m[other] - cells.position_m[rows[mine]]
        its = normal[rows[mine]]
        bends = cells.bow_m[other] > 0.0
        bends |= np.abs(np.einsum("nx,nx->n", its, way)) > FLAT * spacing_m
        bends &= (
            np.einsum("nx,nx->n", its, normal[other]) > 0.5
        )  # others are beyond a crease, or of another sheet
        inner[rows[mine[bends]]] = False
        mine, other = near(all_spots, half_m)
        way, half = cells.position_m[rows[mine]] - spots.position_m[other], spots.half_m[other]
        along = np.einsum("nx,nx->n", way, half) / np.maximum(half_m[other] ** 2, 1e-300)
        way -= np.clip(along, -1.0, 1.0)[:, None] * half
        inner[rows[mine[np.linalg.norm(way, axis=1) < wide_m[mine]]]] = False
    return inner
