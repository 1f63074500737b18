"""Bricks in which the static object is a few planes, so that the tick needs no samples there."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crease.bake.kinds import Kinds, Probes
from crease.bake.layout import KIND_FACETS_MAX
from crease.base.native import lib

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
Facets = tuple[int, ...]

CHUNK = 256
"""Bricks that are checked at once."""
PROBE_SIDE = 17
"""Points a side at which planes are checked where those of some cell did not agree: two a voxel."""
SIGNS = {int(lib.CR_KIND_CONVEX): 1.0, int(lib.CR_KIND_CONCAVE): -1.0}


@dataclass(frozen=True)
class BrickPlanes:
    """Kinds whose planes give the distance anywhere in a brick, 0 where none do. Shapes: (bricks,).

    least: those of the facets that its cells see. most: those of the facets that its neighbours see too. Bricks beside
    each other often have one in common, and a cluster of samples that reaches into both takes that.
    """

    least: I32
    most: I32


@dataclass(frozen=True)
class NearBricks:
    """What is known of the near bricks.

    Shapes: where (n, 3) brick indices x, y, z; phi (n, 9, 9, 9); cells (n, 8, 8, 8). points_of: samples of bricks
    (m, 3), side^3 in each, as (m, side^3, 3); distance_of: exact distances of points.
    """

    where: npt.NDArray[np.int64]
    phi: F64
    cells: I32
    points_of: Callable[[npt.NDArray[np.int64], int], F64]
    distance_of: Callable[[F64], F64]


class _Checker:
    """Checks planes against exact distances: at base samples, and at PROBE_SIDE^3 points where cells are MIXED."""

    def __init__(self, bricks: NearBricks, kinds: Kinds, tolerance_m: float) -> None:
        self._bricks, self._kinds, self._tolerance_m = bricks, kinds, tolerance_m
        rows = np.array([kinds.row(i)[0] == int(lib.CR_KIND_MIXED) for i in range(len(kinds))])
        self._mixed = np.asarray(rows[bricks.cells].any(axis=(1, 2, 3)))

    def find(self, seen: list[Facets]) -> I32:
        """For each brick the kind of these facets that gives its distances, 0: none."""
        groups: dict[Facets, list[int]] = defaultdict(list)
        for i, facets in enumerate(seen):
            if 0 < len(facets) <= KIND_FACETS_MAX:
                groups[facets].append(i)
        found = np.zeros(len(seen), np.int32)
        for facets, rows in groups.items():
            for kind in (int(lib.CR_KIND_PLANAR),) if len(facets) == 1 else SIGNS:
                left = np.array([i for i in rows if found[i] == 0], np.int64)
                for part in np.split(left, range(CHUNK, len(left), CHUNK)):
                    good = self._agreeing(kind, facets, part)
                    if len(good):
                        found[good] = self._kinds.index(kind, facets)
        return found

    def _agreeing(
        self, kind: int, facets: Facets, rows: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int64]:
        sign, planes, b = SIGNS.get(kind, 1.0), self._kinds.planes_of(facets), self._bricks
        if len(rows) == 0:
            return rows

        def agree(points: F64, exact: F64, of: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
            probes = Probes(points, exact, math.inf, self._tolerance_m, self._tolerance_m)
            return np.asarray(of[probes.agreeing(sign, planes, np.arange(len(of)))])

        rows = agree(b.points_of(b.where[rows], b.phi.shape[1]), b.phi[rows], rows)
        mixed = self._mixed[rows]
        if not mixed.any():
            return rows
        points = b.points_of(b.where[rows[mixed]], PROBE_SIDE)
        exact = b.distance_of(points).reshape(points.shape[:2])
        return np.concatenate([rows[~mixed], agree(points, exact, rows[mixed])])


def find_planes(bricks: NearBricks, kinds: Kinds, tolerance_m: float) -> BrickPlanes:
    """Planes of the near bricks."""
    cells = bricks.cells.reshape(len(bricks.cells), -1)
    seen = [_facets_seen(kinds, np.unique(brick)) for brick in cells]
    checker = _Checker(bricks, kinds, tolerance_m)
    least, most = checker.find(seen), checker.find(_with_neighbours(bricks.where, seen))
    return BrickPlanes(np.where(least != 0, least, most), np.where(most != 0, most, least))


def _facets_seen(kinds: Kinds, rows: Iterable[int]) -> Facets:
    """All facets that these kinds name; none when one of them stands for a curved surface."""
    facets = {facet for row in rows for facet in kinds.row(int(row))[1]}
    return () if any(kinds.is_curved(facet) for facet in facets) else tuple(sorted(facets))


def _with_neighbours(where: npt.NDArray[np.int64], seen: list[Facets]) -> list[Facets]:
    """The facets that each brick and the 26 round it see; none where the brick itself sees none."""
    at = {place: i for i, place in enumerate(map(tuple, where.tolist()))}
    steps = [(x, y, z) for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    wider: list[Facets] = []
    for i, (x, y, z) in enumerate(where.tolist()):
        near = (at.get((x + a, y + b, z + c)) for a, b, c in steps) if seen[i] else ()
        wider.append(tuple(sorted({f for n in near if n is not None for f in seen[n]})))
    return wider
