"""Slivers that are mended in place: a corner that lies on the opposite edge, two corners that lie on each other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from crease.mesh import topology
from crease.mesh.topology import Indices, Triangles, Vertices

ROUNDS = 50
"""After that, what is left stays: a fan of slivers on one edge loses one of them in a round."""
SEED = 20183
"""Of the order in which corners are joined: the same each time."""


def mend_slivers(vertices: Vertices, triangles: Triangles, limit_m: float) -> Triangles:
    """The same closed surface with fewer triangles of an altitude below limit_m; it moves by little more than that.

    Corners of edges shorter than limit_m are thinned out, and the long edge of a sliver is turned into the triangle
    beyond it.
    """
    order = np.random.default_rng(SEED)
    for _ in range(ROUNDS):
        joined = _joined(vertices, triangles, limit_m, order.permutation(len(vertices)))
        turned, count = _turned(vertices, joined, limit_m)
        if count == 0 and len(turned) == len(triangles):
            return turned
        triangles = turned
    return triangles


def _joined(vertices: Vertices, triangles: Triangles, limit_m: float, rank: Indices) -> Triangles:
    """Corners of an edge shorter than limit_m made one; what vanishes is left out.

    Those of a lower rank than all their neighbours stay and take these: corners that hang together are thinned out,
    round after round, not made one point. A rank along the chain would take one of them in a round.
    """
    start, end = topology.directed_edges(triangles)
    short = np.linalg.norm(vertices[end] - vertices[start], axis=1) < limit_m
    if not short.any():
        return triangles
    one, two = np.r_[start[short], end[short]], np.r_[end[short], start[short]]
    lowest = rank.copy()
    np.minimum.at(lowest, one, rank[two])
    stays = lowest == rank
    takes = rank.copy()
    np.minimum.at(takes, one[stays[two]], rank[two[stays[two]]])
    of_rank = np.empty_like(rank)
    of_rank[rank] = np.arange(len(rank))
    made: Triangles = of_rank[takes][triangles].astype(np.int32)
    a, b, c = made.T
    return np.asarray(made[(a != b) & (b != c) & (c != a)])


def _turned(vertices: Vertices, triangles: Triangles, limit_m: float) -> tuple[Triangles, int]:
    """Long edges of slivers turned where the least altitude of both triangles grows, and how many: the thinnest first,
    none twice."""
    altitude_m = topology.altitudes_m(vertices, triangles)
    if not (altitude_m < limit_m).any():
        return triangles, 0
    slivers, others, made = _turns(vertices, triangles, altitude_m, limit_m)
    before_m = np.minimum(altitude_m[slivers], altitude_m[others])
    after_m = topology.altitudes_m(vertices, made.reshape(-1, 3)).reshape(-1, 2).min(axis=1)
    better = np.flatnonzero(after_m > before_m)
    better = better[np.argsort(altitude_m[slivers[better]], kind="stable")]
    taken: set[int] = set()
    new_edges: set[tuple[int, int]] = set()
    chosen = []
    for i in better.tolist():
        pair = {int(slivers[i]), int(others[i])}
        tip, far = sorted((int(made[i, 0, 2]), int(made[i, 0, 1])))
        if taken.isdisjoint(pair) and (tip, far) not in new_edges:
            taken |= pair
            new_edges.add((tip, far))
            chosen.append(i)
    turned = triangles.copy()
    turned[slivers[chosen]], turned[others[chosen]] = made[chosen, 0], made[chosen, 1]
    return turned, len(chosen)


def _turns(
    vertices: Vertices, triangles: Triangles, altitude_m: npt.NDArray[np.float64], limit_m: float
) -> tuple[Indices, Indices, Triangles]:
    """Slivers with one triangle across their longest edge, these, and both with that edge turned, (n, 2, 3)."""
    one, two = topology.paired_edges(triangles, len(vertices))
    start, end = topology.directed_edges(triangles)
    corners = vertices[triangles]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
    near, over = np.r_[one, two], np.r_[two, one]
    mine = (altitude_m[near // 3] < limit_m) & (longest[near // 3] == near % 3)
    near, over = near[mine], over[mine]
    a, b = start[near], end[near]
    tip, far = (triangles[e // 3, (e % 3 + 2) % 3].astype(np.int64) for e in (near, over))
    codes = np.unique(topology.undirected_codes(triangles, len(vertices)))
    new = np.minimum(tip, far) * len(vertices) + np.maximum(tip, far)
    good = (start[over] == b) & (tip != far) & ~np.isin(new, codes)
    made = np.stack([a, far, tip, far, b, tip], axis=1).reshape(-1, 2, 3).astype(np.int32)
    return near[good] // 3, over[good] // 3, made[good]
