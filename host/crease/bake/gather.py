"""Fine points of a tool's surface by the cell that each is in: searches and sums in C (host/native/sites.h)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crease.bake.surface import THREADS
from crease.bake.vectors import F64, I64
from crease.base.errors import MeshError
from crease.base.native import ffi, lib

I32 = npt.NDArray[np.int32]

FINE_SPREAD = 0.0962
"""Second moment of an equilateral triangle about its centroid, per axis, as a share of its area: sqrt(3) / 18."""
CHUNK = 65_536
CELL = 2.0
"""Side of a cell of the search, in distances between sites: with 1 a step takes 40 % longer, with 3 as long."""


@dataclass(frozen=True)
class FinePoints:
    """A surface in fine pieces, those of one triangle alike.

    Shapes: position_m (n, 3), triangle (n,); normal, area_m2 (vectors) (triangles, 3); weight_m2 (triangles,).
    """

    position_m: F64
    triangle: I32
    normal: F64
    area_m2: F64
    weight_m2: F64

    def of(self, rows: I64) -> FinePoints:
        """Some of them, in the order of rows."""
        return replace(self, position_m=self.position_m[rows], triangle=self.triangle[rows])


class Gathered:
    """Fine points with their normals, lift_m long, as three more coordinates. Labels (n,) tell in which cell each is.

    Output   the same to the bit whatever the number of threads: sums are taken in the order of the points.
    """

    def __init__(self, fine: FinePoints, lift_m: float, site_distance_m: float) -> None:
        self._fine = fine
        self._lift_m = lift_m
        self._distance_m = site_distance_m
        self._points = ffi.new(
            "crs_points *",
            {
                "count": len(fine.triangle),
                "point_m": _doubles(fine.position_m),
                "triangle": _ints(fine.triangle),
                "normal": _doubles(fine.normal),
                "weight_m2": _doubles(fine.weight_m2),
                "lift_m": lift_m,
            },
        )

    def means(self, label: I32) -> F64:
        """Mean places and lifted normals of each label, (labels, 6), by area."""
        count = int(label.max()) + 1
        mean, weight = np.empty((count, 6)), np.empty(count)
        lib.crs_means(self._points, _ints(label), count, _doubles(mean), _doubles(weight))
        return mean

    def nearest(self, sites: F64, guess: I32) -> I32:
        """The nearest of sites (m, 6) to each point, (n,); of equally near ones that which a k-d tree takes."""
        label, tied = guess.copy(), np.empty(len(guess), np.uint8)
        grid = self._grid(sites)

        def work(first: int) -> None:
            end = min(first + CHUNK, len(label))
            lib.crs_nearest(
                grid, self._points, first, end, _ints(label), ffi.from_buffer("uint8_t[]", tied)
            )

        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(work, range(0, len(label), CHUNK)))
        rows = np.flatnonzero(tied)
        if len(rows):
            lift = self._lift_m * self._fine.normal[self._fine.triangle[rows]]
            lifted = np.hstack([self._fine.position_m[rows], lift])
            label[rows] = cKDTree(sites).query(lifted, workers=THREADS)[1]
        return label

    def closest(self, middle_m: F64, label: I32) -> I64:
        """The point nearest to the middle of each label, (labels,), whosever it is; of equally near ones the first."""
        near, distance2 = np.empty(len(middle_m), np.int64), np.empty(len(middle_m))
        lib.crs_closest(
            self._grid(middle_m),
            self._points,
            _ints(label),
            ffi.from_buffer("int64_t[]", near),
            _doubles(distance2),
        )
        return near

    def spreads(self, middle_m: F64, label: I32) -> F64:
        """Mean of d d^T over each label, d from its middle, the size of the fine pieces included; (labels, 3, 3)."""
        count = len(middle_m)
        spread = np.empty((count, 3, 3))
        weight = np.bincount(label, self._fine.weight_m2[self._fine.triangle])
        lib.crs_spreads(
            self._points, _ints(label), FINE_SPREAD, _doubles(middle_m), count, _doubles(spread)
        )
        return np.asarray(spread / np.maximum(weight, 1e-300)[:, None, None])

    def bows(self, site_m: F64, normal: F64, label: I32) -> F64:
        """How far the pieces of each label reach behind the plane through its site, (labels,)."""
        bow = np.empty(len(site_m))
        site, up = np.ascontiguousarray(site_m), np.ascontiguousarray(normal)
        lib.crs_bows(
            self._points, _ints(label), _doubles(site), _doubles(up), len(bow), _doubles(bow)
        )
        return bow

    def _grid(self, sites: F64) -> Any:
        raw = lib.crs_new(_doubles(sites), sites.shape[1], len(sites), CELL * self._distance_m)
        if raw == ffi.NULL:
            raise MeshError(f"not enough memory for {len(sites):,} samples of the tool")
        return ffi.gc(raw, lib.crs_free)


def _doubles(array: F64) -> Any:
    return ffi.from_buffer("double[]", array)


def _ints(array: I32) -> Any:
    return ffi.from_buffer("int32_t[]", array)
