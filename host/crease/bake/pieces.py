"""Convex pieces of the tool's surface: a cover by sets of clusters that bend away from each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crease.bake.surface import Surface

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

RISE_MAX = 0.15
"""Sine of the elevation of a cluster above the plane of another up to which both may be of one piece: what is curved
concavely is cut into pieces of some 17 degrees."""
BESIDE = 1.6
"""Clusters are beside each other when samples of theirs are nearer than this many spacings."""
PIECE_NONE = 0xFFFF
SIGHTS = (0.25, 0.5, 0.75)
"""Where on the way from one cluster to another it is asked whether the way is inside."""
WITNESSES = 64
"""Of the clusters of a piece so many are asked whether they see a new one."""
KNOWN_BOXES = 64
"""Boxes along the longest side of a tool whose distances are kept: they tell of most ways that they are inside."""
SLACK = 0.1
"""How far below the surface ways go, and how far they may be outside, in spacings."""


def _beside(points: F64, cluster: I64, reach_m: float) -> list[I64]:
    """Clusters beside each cluster. Shapes: points (n, 3), cluster (n,)."""
    count = int(cluster.max()) + 1
    pairs = cKDTree(points).query_pairs(reach_m, output_type="ndarray")
    ends = cluster[pairs]
    ends = ends[ends[:, 0] != ends[:, 1]]
    keys = np.unique(np.concatenate([ends @ [count, 1], ends @ [1, count]]))
    both = np.column_stack([keys // count, keys % count])
    starts = np.searchsorted(both[:, 0], np.arange(count + 1))
    return [both[starts[i] : starts[i + 1], 1] for i in range(count)]


def _agrees(centre: F64, normal: F64, i: int) -> Bools:
    """Clusters that cluster i may be of one piece with: none lies above the plane of the other."""
    way = centre - centre[i]
    far = np.linalg.norm(way, axis=1)
    above = np.maximum(way @ normal[i], -np.einsum("ij,ij->i", way, normal))
    return np.asarray(above <= RISE_MAX * far + 1e-12)


Inside = Callable[[F64], bool]
"""Whether all of some points (n, 3) are inside the tool, or nearly so."""


def _sees(inner: F64, inside: Inside, i: int, others: I64) -> bool:
    """Whether straight lines from cluster i to others stay inside the tool. Shapes: inner (n, 3), below the surface."""
    others = others[:: max(1, len(others) // WITNESSES)]
    return inside(np.concatenate([inner[i] + t * (inner[others] - inner[i]) for t in SIGHTS]))


def _grow(
    seed: int, centre: F64, normal: F64, beside: list[I64], inner: F64, inside: Inside
) -> I64:
    """A piece round a cluster: what hangs together with it and agrees with all of it, nearest first."""
    member = np.zeros(len(centre), bool)
    member[seed] = True
    allowed = _agrees(centre, normal, seed)
    front = [seed]
    while front:
        found = np.unique(np.concatenate([beside[i] for i in front]))
        found = found[allowed[found] & ~member[found]]
        found = found[
            np.argsort(np.linalg.norm(centre[found] - centre[seed], axis=1), kind="stable")
        ]
        front = []
        for i in found:
            if allowed[i] and _sees(inner, inside, int(i), np.flatnonzero(member)):
                member[i] = True
                allowed &= _agrees(centre, normal, int(i))
                front.append(int(i))
            else:
                allowed[i] = False
    return np.flatnonzero(member)


def find_pieces(
    centre: F64, normal: F64, beside: list[I64], inset_m: float, inside: Inside
) -> list[I64]:
    """Convex pieces that cover all clusters, each as large as it grows; those inside another are left out.

    Shapes: centre, normal (clusters, 3); beside: for each cluster those beside it.
    """
    inner = centre - inset_m * normal
    covered = np.zeros(len(centre), bool)
    pieces: list[I64] = []
    for seed in range(len(centre)):
        if not covered[seed]:
            piece = _grow(seed, centre, normal, beside, inner, inside)
            covered[piece] = True
            pieces.append(piece)
    return pieces


def mark_pieces(
    normal: npt.NDArray[Any], position_m: F64, order: list[I64], spacing_m: float, surface: Surface
) -> I64:
    """The two largest pieces of each cluster, (clusters, 2), PIECE_NONE where there is none.

    Shapes: normal (clusters, 3); position_m (n, 3) of the samples, order: those of each cluster.
    """
    cluster = np.concatenate([np.full(len(ids), i) for i, ids in enumerate(order)])
    points = position_m[np.concatenate(order)]
    centre = np.array([position_m[ids].mean(axis=0) for ids in order])
    reach_m = SLACK * spacing_m
    inside = surface.below(reach_m, KNOWN_BOXES)
    beside = _beside(points, cluster, BESIDE * spacing_m)
    pieces = find_pieces(centre, normal.astype(np.float64), beside, reach_m, inside)
    out = np.full((len(order), 2), PIECE_NONE, np.int64)
    for piece in sorted(range(len(pieces)), key=lambda p: -len(pieces[p]))[:PIECE_NONE]:
        rows = pieces[piece]
        for slot in (0, 1):
            free = out[rows, slot] == PIECE_NONE
            out[rows[free], slot] = piece
            rows = rows[~free]
    return out
