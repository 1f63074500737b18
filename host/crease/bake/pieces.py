"""Convex pieces of the tool's surface: sets of clusters that bend away from each other, and the samples of each."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crease.bake.surface import Surface
from crease.base.errors import MeshError
from crease.base.native import ffi, lib
from crease.base.settings import setting

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]

RISE_MAX = 0.15
"""Sine of the elevation of a cluster above the plane of another up to which both may be of one piece: what is curved
concavely is cut into pieces of some 17 degrees."""
SHARP = 0.8
"""Cosine of the normals of clusters from which on they are of one bent surface: others meet in an edge."""
BESIDE = 1.6
"""Clusters are beside each other when samples of theirs are nearer than this many spacings."""
PIECE_NONE = 0xFFFF
NOBODY = np.zeros(0, np.int64)
WITNESSES = 64
"""Of the clusters of a piece so many are asked whether they see a new one."""
KNOWN_BOXES = 64
"""Boxes along the longest side of a tool whose distances are kept: they tell of most ways that they are inside. With
twice as many pieces take up to half as long again: filling them costs more than they save."""
EDGE_SLACK = 0.01
"""How far a sample of a piece may lie above its planes beyond an edge, in spacings: as far it may be felt too deep."""
NEAR = 2.5
"""A sample behind the planes of no piece is of one that has samples within so many spacings of it."""
WHOLE_EDGE = 3.0
"""So near a convex edge at which its piece ends, in spacings, a sample may be of another, that goes on beyond it."""
SLACK = 0.1
"""How far below the surface ways go, and how far they may be outside, in spacings."""


def _beside(points: F64, cluster: I64, reach_m: float) -> tuple[I32, I32]:
    """Clusters beside cluster i: second[first[i]:first[i + 1]]. Shapes: points (n, 3), cluster (n,)."""
    count = int(cluster.max()) + 1
    pairs = cKDTree(points).query_pairs(reach_m, output_type="ndarray")
    ends = cluster[pairs]
    ends = ends[ends[:, 0] != ends[:, 1]]
    keys = np.unique(np.concatenate([ends @ [count, 1], ends @ [1, count]]))
    starts = np.searchsorted(keys // count, np.arange(count + 1))
    return starts.astype(np.int32), (keys % count).astype(np.int32)


def _unknown(surface: Surface) -> tuple[Any, F64]:
    """Boxes of a crb_known, and the array of their distances, to be held as long as these: none is known yet."""
    low, size = surface.mesh.vertices_m.min(axis=0), np.ptp(surface.mesh.vertices_m, axis=0)
    box_m = float(size.max()) / KNOWN_BOXES
    dims = np.maximum(1, np.ceil(size / box_m)).astype(np.int32)
    kept = np.zeros(int(np.prod(dims)))
    room = ffi.from_buffer("double[]", kept)
    return ffi.new("crb_known *", (low.tolist(), box_m, dims.tolist(), room)), kept


def find_pieces(
    surface: Surface, centre: F64, normal: F64, beside: tuple[I32, I32], inset_m: float
) -> list[I64]:
    """Convex pieces that cover all clusters, each as large as it grows; those inside another are left out.

    Shapes: centre, normal (clusters, 3); beside: as _beside has it. inset_m: how far below the surface the ways between
    clusters go, and how far they may be outside.
    """
    rows = [
        np.ascontiguousarray(v, np.float64) for v in (centre, normal, centre - inset_m * normal)
    ]
    parts = ffi.new(
        "crb_parts *",
        {
            "count": len(centre),
            "witnesses": WITNESSES,
            **{
                name: ffi.from_buffer("double[]", row)
                for name, row in zip(("centre_m", "normal", "inner_m"), rows, strict=True)
            },
            "beside_start": ffi.from_buffer("int32_t[]", beside[0]),
            "beside": ffi.from_buffer("int32_t[]", beside[1]),
            "rise_max": RISE_MAX,
            "below_m": inset_m,
        },
    )
    known, _kept = _unknown(surface)
    member = np.zeros(len(centre), np.uint8)
    covered = np.zeros(len(centre), bool)
    pieces: list[I64] = []
    for seed in range(len(centre)):
        if covered[seed]:
            continue
        room = ffi.from_buffer("uint8_t[]", member)
        if not lib.crb_grow_piece(surface.handle, known, parts, seed, room):
            raise MemoryError
        covered |= member != 0
        pieces.append(np.flatnonzero(member))
    return pieces


def _needed(pieces: list[I64], count: int) -> list[I64]:
    """Pieces that cover all clusters that any does: each is the one that covers most of those that were left."""
    of = np.repeat(np.arange(len(pieces)), [len(rows) for rows in pieces])
    of = of[np.argsort(np.concatenate(pieces), kind="stable")]
    ends = np.cumsum(np.bincount(np.concatenate(pieces), minlength=count))
    uncovered = np.array([len(rows) for rows in pieces])
    left, out = np.ones(count, bool), []
    while uncovered.max() > 0:
        most = pieces[int(np.argmax(uncovered))]
        for cluster in most[left[most]]:
            np.subtract.at(uncovered, of[ends[cluster - 1] if cluster else 0 : ends[cluster]], 1)
        left[most] = False
        out.append(most)
    return out


def _at_rim(rows: I64, beside: tuple[I32, I32], centre: F64, normal: F64) -> I64:
    """Clusters where a piece ends: its own beside one that is not, and those of these that lie above its planes.

    One that lies behind all of them is not of it for another reason: it is hidden from it.
    """
    starts, others = beside
    count = len(starts) - 1
    first = np.repeat(np.arange(count), np.diff(starts))
    member = np.zeros(count, bool)
    member[rows] = True
    rim = np.unique(first[member[first] != member[others]]).astype(np.int64)
    far = rim[~member[rim]]
    behind = _lies_behind(centre[far], far, rows, centre, normal, None)
    return np.concatenate([rim[member[rim]], far[~behind]])


def _edges(beside: tuple[I32, I32], centre: F64, normal: F64) -> tuple[I64, I32]:
    """Pairs of clusters beside each other that meet in a convex edge: two arrays of them, each pair both ways."""
    starts, others = beside
    first = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    way = centre[others] - centre[first]
    bends = np.einsum("nx,nx->n", normal[first], normal[others]) < SHARP
    below = np.einsum("nx,nx->n", way, normal[first]) < 0.0
    above = np.einsum("nx,nx->n", way, normal[others]) > 0.0
    edge = bends & below & above
    return first[edge], others[edge]


def _to_cut_edge(
    point: F64, rows: I64, edges: tuple[I64, I32], order: list[I64], position_m: F64, most_m: float
) -> F64:
    """How far points (n, 3) are from the samples beyond the convex edges at which a piece ends, at most most_m.

    rows: clusters of the piece; edges: as _edges has them; order: samples of each cluster, position_m (samples, 3).
    """
    first, others = edges
    member = np.zeros(len(order), bool)
    member[rows] = True
    beyond = np.unique(others[member[first] & ~member[others]])
    if len(beyond) == 0:
        return np.full(len(point), most_m)
    there = position_m[np.concatenate([order[i] for i in beyond])]
    far_m: F64 = cKDTree(there).query(point, distance_upper_bound=most_m)[0]
    return np.minimum(far_m, most_m)


def _lies_behind(
    point: F64, own: I64, rows: I64, centre: F64, normal: F64, slack_m: float | None
) -> npt.NDArray[np.bool_]:
    """Whether points lie behind the planes of clusters, but for that of their own.

    By RISE_MAX, as clusters do, or where those face another way by slack_m, if it is given.

    Shapes: point (n, 3); own (n,), the cluster of each; rows: clusters; centre, normal (clusters, 3).
    """
    left = np.arange(len(point))
    for row in rows:
        way = point[left] - centre[row]
        most = RISE_MAX * np.linalg.norm(way, axis=1)
        if slack_m is not None:
            most = np.where(normal[own[left]] @ normal[row] > SHARP, most, slack_m)
        left = left[(way @ normal[row] <= most) | (own[left] == row)]
    return np.isin(np.arange(len(point)), left)


def _rise_m(point: F64, own: int, rows: I64, centre: F64, normal: F64) -> float:
    """How far a point (3,) rises above the planes of clusters `rows` but that of its own, at least 0.

    Above those that face as its own does, beyond what RISE_MAX allows. Shapes: centre, normal (clusters, 3).
    """
    others = rows[rows != own]
    way = point - centre[others]
    alike = normal[others] @ normal[own] > SHARP
    allowed = np.where(alike, RISE_MAX * np.linalg.norm(way, axis=1), 0.0)
    rise = np.einsum("nx,nx->n", way, normal[others]) - allowed
    return float(rise.max(initial=0.0))


def _least_risen(
    out: I64,
    position_m: F64,
    cluster: I64,
    pieces: list[I64],
    centre: F64,
    normal: F64,
    near_m: float,
) -> I64:
    """out, the piece of each sample (n,), with those of none in the piece above whose planes they rise least.

    Of the pieces of samples within near_m and those of the sample's cluster; of equal ones the first. Shapes:
    position_m (n, 3), cluster (n,); centre, normal (clusters, 3).
    """
    lost, known = np.flatnonzero(out == PIECE_NONE), np.flatnonzero(out != PIECE_NONE)
    near = cKDTree(position_m[lost].reshape(-1, 3)).query_ball_tree(
        cKDTree(position_m[known].reshape(-1, 3)), near_m
    )
    holders: list[list[int]] = [[] for _ in centre]
    for piece, rows in enumerate(pieces):
        for row in rows:
            holders[row].append(piece)
    made = out.copy()
    for sample, ids in zip(lost, near, strict=True):
        point, own = position_m[sample], int(cluster[sample])
        asked = {*out[known[ids]].tolist(), *holders[own]}
        rises = [(_rise_m(point, own, pieces[k], centre, normal), k) for k in sorted(asked)]
        made[sample] = min(rises)[1]
    return made


def mark_pieces(
    normal: npt.NDArray[Any], position_m: F64, order: list[I64], spacing_m: float, surface: Surface
) -> I64:
    """The piece of each sample, (n,): the first of those that are needed.

    Where a piece ends a sample is of it when it lies behind all its planes, whatever its cluster: that may reach across
    a notch. Beside a convex edge at which that ends it is of a piece that goes on beyond: an edge is felt as one only
    where both its sides are of one piece. One that is of none so is of that near it above whose planes it rises least.

    Shapes: normal (clusters, 3); position_m (n, 3) of the samples, order: those of each cluster.
    """
    cluster = np.empty(len(position_m), np.int64)
    for i, ids in enumerate(order):
        cluster[ids] = i
    centre = np.array([position_m[ids].mean(axis=0) for ids in order])
    normal = normal.astype(np.float64)
    beside = _beside(position_m, cluster, BESIDE * spacing_m)
    pieces = _needed(find_pieces(surface, centre, normal, beside, SLACK * spacing_m), len(centre))
    if len(pieces) > PIECE_NONE:
        raise MeshError(
            f"{len(pieces):,} convex pieces of the tool, at most {PIECE_NONE:,}: give one body, or a larger "
            f"{setting('spacing_m')}"
        )
    out = np.full(len(position_m), PIECE_NONE, np.int64)
    edges, clear_m = _edges(beside, centre, normal), np.zeros(len(position_m))
    for piece, rows in enumerate(pieces):
        its = np.isin(cluster, rows)
        rim = np.concatenate([NOBODY, *(order[i] for i in _at_rim(rows, beside, centre, normal))])
        its[rim] = _lies_behind(
            position_m[rim], cluster[rim], rows, centre, normal, EDGE_SLACK * spacing_m
        )
        own = np.flatnonzero(its)
        far_m = _to_cut_edge(
            position_m[own], rows, edges, order, position_m, WHOLE_EDGE * spacing_m
        )
        better = far_m > clear_m[own]
        out[own[better]], clear_m[own[better]] = piece, far_m[better]
    return _least_risen(out, position_m, cluster, pieces, centre, normal, NEAR * spacing_m)
