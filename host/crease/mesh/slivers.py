"""Slivers that are mended in place: a corner that lies on the opposite edge, two corners that lie on each other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from crease.mesh import topology
from crease.mesh.topology import Triangles, Vertices

ROUNDS = 20


def mend_slivers(vertices: Vertices, triangles: Triangles, limit_m: float) -> Triangles:
    """The same closed surface with fewer triangles of an altitude below limit_m; it moves by less than that.

    Corners nearer than limit_m are one, and the long edge of a sliver is turned into its other triangle. Triangles with
    two equal corners are left to be dropped.
    """
    for _ in range(ROUNDS):
        joined = _joined(vertices, triangles, limit_m)
        turned, count = _turned(vertices, joined, limit_m)
        if count == 0 and len(turned) == len(triangles):
            return turned
        triangles = turned
    return triangles


def _joined(vertices: Vertices, triangles: Triangles, limit_m: float) -> Triangles:
    """Corners of an edge shorter than limit_m made one, those that hang together too; what vanishes is left out."""
    start, end = topology.directed_edges(triangles)
    short = np.linalg.norm(vertices[end] - vertices[start], axis=1) < limit_m
    if not short.any():
        return triangles
    beside = sparse.coo_matrix(
        (np.ones(np.count_nonzero(short)), (start[short], end[short])), (len(vertices),) * 2
    )
    _, kind = csgraph.connected_components(beside, directed=False)
    first = np.unique(kind, return_index=True)[1]
    triangles = first[kind][triangles].astype(np.int32)
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _turned(vertices: Vertices, triangles: Triangles, limit_m: float) -> tuple[Triangles, int]:
    """Long edges of slivers turned where the least altitude of both triangles grows, and how many."""
    altitude_m = topology.altitudes_m(vertices, triangles)
    thin = np.flatnonzero(altitude_m < limit_m)
    triangles = triangles.copy()
    start, end = topology.directed_edges(triangles)
    over: dict[tuple[int, int], list[int]] = {}
    for i, edge in enumerate(zip(start.tolist(), end.tolist(), strict=True)):
        over.setdefault(edge, []).append(i // 3)
    count = 0
    for i in thin[np.argsort(altitude_m[thin], kind="stable")].tolist():
        corners = vertices[triangles[i]]
        k = int(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).argmax())
        a, b, tip = (int(triangles[i, (k + j) % 3]) for j in range(3))
        own, others = over.get((a, b), []), over.get((b, a), [])
        if len(own) != 1 or len(others) != 1:
            continue
        j = others[0]
        far = int(triangles[j].sum()) - a - b
        if far == tip or over.get((tip, far)) or over.get((far, tip)):
            continue
        made = np.array([[a, far, tip], [far, b, tip]], np.int32)
        before = topology.altitudes_m(vertices, triangles[[i, j]]).min()
        if topology.altitudes_m(vertices, made).min() <= before:
            continue
        for old in (i, j):
            for edge in pairwise([*triangles[old].tolist(), int(triangles[old, 0])]):
                over[edge].remove(old)
        triangles[[i, j]] = made
        for new in (i, j):
            for edge in pairwise([*triangles[new].tolist(), int(triangles[new, 0])]):
                over.setdefault(edge, []).append(new)
        count += 1
    return triangles, count
