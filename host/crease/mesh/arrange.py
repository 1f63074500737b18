"""The outer surface of any closed triangles: cut where they cross, and kept where they part inside from outside.

Inside is where the triangles wind round a point at least once (generalised winding number), so that crossing shells are
united and inner faces vanish.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from crease.base.native import ffi, lib
from crease.mesh import topology
from crease.mesh.topology import Triangles, Vertices

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

SHAKE = 1e-9
"""Share of the diagonal by which crossing triangles are shaken, so that nothing lies exactly in the plane of another.
Below what single precision keeps, above the rounding of the cuts."""
SEED = 20181
TRIED = 5
"""Triangles of a piece that are asked where it lies, the largest first, until one answers clearly."""
CLEAR = 0.2
"""How far a winding number may be from a half on a triangle that is taken as clear."""
BESIDE = 1e-8
"""Share of the diagonal at which both sides of a wall are asked: further than SHAKE moves it, nearer than solids."""
THREADS = 2
_CHUNK = 4096


class Winding:
    """The generalised winding number of triangles: how often they go round a point."""

    def __init__(self, vertices: Vertices, triangles: Triangles) -> None:
        points = np.ascontiguousarray(vertices, np.float64)
        corners = np.ascontiguousarray(triangles, np.int32)
        raw = lib.crw_new(
            ffi.from_buffer("double[]", points), ffi.from_buffer("int32_t[]", corners), len(corners)
        )
        if raw == ffi.NULL:
            raise MemoryError
        self._tree = ffi.gc(raw, lib.crw_free)

    def at(self, points_m: F64, without: I32 | None = None) -> F64:
        """Winding numbers of points (n, 3), each without one triangle where `without` (n,) names it.   Shape: (n,)."""
        points = np.ascontiguousarray(points_m, np.float64).reshape(-1, 3)
        skipped = None if without is None else np.ascontiguousarray(without, np.int32)
        result = np.empty(len(points))

        def work(first: int) -> None:
            end = min(first + _CHUNK, len(points))
            lib.crw_winding(
                self._tree,
                ffi.from_buffer("double[]", points[first:end]),
                end - first,
                ffi.NULL if skipped is None else ffi.from_buffer("int32_t[]", skipped[first:end]),
                ffi.from_buffer("double[]", result[first:end]),
            )

        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(work, range(0, len(points), _CHUNK)))
        return result


@dataclass(frozen=True)
class Arrangement:
    """Triangles that meet only in edges and corners.

    Shapes: lines (k, 2) edges that lie on a triangle of another piece. crossings: pairs that were cut; failed:
    triangles left whole.
    """

    vertices: Vertices
    triangles: Triangles
    lines: I32
    crossings: int
    failed: int


def cut_crossings(vertices: Vertices, triangles: Triangles) -> Arrangement:
    """Cut triangles where others pass through them.   Errors: MemoryError."""
    crossing = topology.crossing_pairs(vertices, triangles, 0.0)
    if len(crossing) == 0:
        return Arrangement(vertices, triangles, np.zeros((0, 2), np.int32), 0, 0)
    points = _shaken(vertices, triangles)
    pairs = np.ascontiguousarray(topology.crossing_pairs(points, triangles, 0.0))
    corners = np.ascontiguousarray(triangles, np.int32)
    raw = lib.crx_cut(
        ffi.from_buffer("double[]", points),
        len(points),
        ffi.from_buffer("int32_t[]", corners),
        len(corners),
        ffi.from_buffer("int32_t[]", pairs.reshape(-1)),
        len(pairs),
    )
    if raw == ffi.NULL:
        raise MemoryError
    cuts = ffi.gc(raw, lib.crx_free)
    counts = ffi.new("crx_counts *")
    lib.crx_count(cuts, counts)
    new_points = np.empty((counts.vertices, 3))
    pieces, parent = np.empty((counts.triangles, 3), np.int32), np.empty(counts.triangles, np.int32)
    lines = np.empty((counts.lines, 2), np.int32)
    lib.crx_read(
        cuts,
        ffi.from_buffer("double[]", new_points.reshape(-1)),
        ffi.from_buffer("int32_t[]", pieces.reshape(-1)),
        ffi.from_buffer("int32_t[]", parent),
        ffi.from_buffer("int32_t[]", lines.reshape(-1)),
    )
    return Arrangement(new_points, pieces, lines, len(pairs), int(counts.failed))


def _shaken(vertices: Vertices, triangles: Triangles) -> Vertices:
    """Vertices moved by SHAKE of the diagonal."""
    used = vertices[triangles.reshape(-1)]
    diagonal = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))
    shake = np.random.default_rng(SEED).uniform(-1.0, 1.0, vertices.shape)
    return np.ascontiguousarray(vertices + SHAKE * diagonal * shake)


def walls(vertices: Vertices, triangles: Triangles) -> npt.NDArray[np.bool_]:
    """Which triangles (m,) of a closed surface have the same on both sides, of pieces with an edge of more than two.

    In the plane of a wall whose two sides are cut otherwise the winding number is rounding: it is asked beside it.
    """
    codes = topology.undirected_codes(triangles, len(vertices))
    _, kind, uses = np.unique(codes, return_inverse=True, return_counts=True)
    crowded = np.flatnonzero(uses[kind.reshape(-1)] > 2) // 3
    none = np.zeros(len(triangles), bool)
    if len(crowded) == 0:
        return none
    lines = np.zeros((0, 2), np.int32)
    count, piece = _pieces(Arrangement(vertices, triangles, lines, 0, 0))
    altitude_m = topology.altitudes_m(vertices, triangles)
    order = np.lexsort((-altitude_m, piece))
    widest = order[np.searchsorted(piece[order], np.arange(count))]
    corners = vertices[triangles]
    beside_m = BESIDE * float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    touching = none.copy()
    touching[crowded] = True
    asked = widest[np.bincount(piece, touching, count) > 0]
    asked = asked[altitude_m[asked] > 100.0 * beside_m]
    a, b, c = (corners[asked, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal *= beside_m / np.linalg.norm(normal, axis=1)[:, None]
    winding = Winding(vertices, triangles)
    behind, before = (winding.at((a + b + c) / 3.0 + side * normal) for side in (-1.0, 1.0))
    return np.isin(piece, piece[asked[np.abs(behind - before) < 0.5]])


def outer_surface(made: Arrangement) -> tuple[Triangles, int]:
    """The triangles that part inside (winding number 1 or more) from outside, and how many pieces were not clear."""
    vertices, triangles = made.vertices, made.triangles
    piece_count, piece = _pieces(made)
    area = topology.areas_m2(vertices, triangles)
    order = np.lexsort((-area, piece))
    starts = np.searchsorted(piece[order], np.arange(piece_count + 1))
    winding = Winding(vertices, triangles)
    value = np.full(piece_count, np.nan)
    open_pieces = np.arange(piece_count)
    for rank in range(TRIED):
        open_pieces = open_pieces[starts[open_pieces] + rank < starts[open_pieces + 1]]
        if len(open_pieces) == 0:
            break
        asked = order[starts[open_pieces] + rank]
        found = winding.at(vertices[triangles[asked]].mean(axis=1), asked.astype(np.int32))
        clear = np.abs(found - np.floor(found) - 0.5) < CLEAR
        value[open_pieces[clear]] = found[clear]
        open_pieces = open_pieces[~clear]
    kept = np.floor(value) == 0.0
    return triangles[kept[piece]], int(np.isnan(value).sum())


def _pieces(made: Arrangement) -> tuple[int, npt.NDArray[np.int64]]:
    """Triangles joined over edges of exactly two that lie on no other triangle."""
    triangles, count = made.triangles, len(made.vertices)
    codes = topology.undirected_codes(triangles, count)
    lines = np.sort(made.lines.astype(np.int64), axis=1)
    order = np.argsort(codes, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(codes[order]) != 0])
    uses = np.diff(np.r_[starts, len(codes)])
    plain = starts[(uses == 2) & ~np.isin(codes[order[starts]], lines[:, 0] * count + lines[:, 1])]
    one, two = order[plain] // 3, order[plain + 1] // 3
    graph = sparse.coo_matrix(
        (np.ones(len(one), np.int8), (one, two)), shape=(len(triangles), len(triangles))
    )
    number, piece = csgraph.connected_components(graph, directed=False)
    return int(number), piece.astype(np.int64)
