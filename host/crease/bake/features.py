"""What sticks out of a tool besides its faces: corners, and convex creases cut into straight pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crease.bake.surface import Surface
from crease.bake.vectors import F64, I64, nanometres, unit

TIP_TURN = 0.35
"""A crease that turns by more than this (2 sin of half the angle; 20 degrees) has a corner there."""


def thin(points: F64, distance_m: float, taken: F64) -> I64:
    """Indices of points at least distance_m apart and from `taken`, earlier ones first."""
    cell = np.floor(points / distance_m).astype(np.int64)
    grid: dict[tuple[int, int, int], list[F64]] = {}

    def is_free(key: tuple[int, int, int], p: F64) -> bool:
        for x in range(key[0] - 1, key[0] + 2):
            for y in range(key[1] - 1, key[1] + 2):
                for z in range(key[2] - 1, key[2] + 2):
                    for q in grid.get((x, y, z), ()):
                        if float(((p - q) ** 2).sum()) < distance_m**2:
                            return False
        return True

    for p, c in zip(taken, np.floor(taken / distance_m).astype(np.int64), strict=True):
        grid.setdefault((int(c[0]), int(c[1]), int(c[2])), []).append(p)
    kept = []
    for i, (p, c) in enumerate(zip(points, cell, strict=True)):
        key = (int(c[0]), int(c[1]), int(c[2]))
        if is_free(key, p):
            grid.setdefault(key, []).append(p)
            kept.append(i)
    return np.array(kept, np.int64)


def vertex_normals(surface: Surface) -> tuple[F64, F64]:
    """Area-weighted unit normal of each vertex and the largest turn (1 - cosine) of a face away from it."""
    v, t = surface.mesh.vertices_m, surface.mesh.triangles
    face = np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]])
    total = np.zeros_like(v)
    for k in range(3):
        np.add.at(total, t[:, k], face)
    normal, turn = unit(total), np.zeros(len(v))
    for k in range(3):
        np.maximum.at(turn, t[:, k], 1 - np.einsum("tx,tx->t", unit(face), normal[t[:, k]]))
    return normal, turn


@dataclass(frozen=True)
class Features:
    """What sticks out of a tool besides its faces: corners, and convex creases cut into straight pieces without a gap.

    Shapes: position_m (middle of the piece), normal, half_m (vector from the middle to one end, 0 at corners) (n, 3);
    slope: of the faces round a vertex of a smooth surface, away from its normal; 0 for others (n,).
    """

    position_m: F64
    normal: F64
    half_m: F64
    slope: F64


def feature_points(surface: Surface, spacing_m: float) -> Features:
    """Corners of creases, other vertices that stick out (a fine, nearly flat surface has none), and crease pieces."""
    v = surface.mesh.vertices_m
    normal, turn = vertex_normals(surface)
    ends = surface.creases.ends_m[surface.creases.convex]
    chains, tips = crease_chains(ends)
    lengths = np.linalg.norm(
        v[surface.mesh.triangles] - v[surface.mesh.triangles[:, [1, 2, 0]]], axis=2
    )
    coarse = float(np.median(lengths)) > spacing_m
    on_crease = np.isin(nanometres(v), nanometres(ends.reshape(-1, 3)))
    first = np.flatnonzero(np.isin(nanometres(v), nanometres(tips)))
    rest = np.flatnonzero(
        ~on_crease & (coarse | (turn > 1 - np.cos(np.radians(10.0)))) & (turn > 1e-6)
    )
    rest = rest[np.argsort(-turn[rest], kind="stable")]
    rest = rest[thin(v[rest], 0.5 * spacing_m, v[first])]
    vertices = np.concatenate([first, rest])
    pieces = [cut_chain(chain, spacing_m) for chain in chains]
    middle = np.concatenate([np.zeros((0, 3)), *(m for m, _ in pieces)])
    half = np.concatenate([np.zeros((0, 3)), *(h for _, h in pieces)])
    cosine = 1.0 - turn[rest]
    slope = np.zeros(len(vertices) + len(middle))
    slope[len(first) : len(vertices)] = np.sqrt(1.0 - cosine**2) / np.maximum(cosine, 1e-3)
    line_normal = unit(_outward(surface, middle, 1e-4 * spacing_m)) if len(middle) else middle
    return Features(
        np.concatenate([v[vertices], middle]),
        np.concatenate([normal[vertices], line_normal]),
        np.concatenate([np.zeros((len(vertices), 3)), half]),
        slope,
    )


def cut_chain(chain: F64, spacing_m: float) -> tuple[F64, F64]:
    """A polyline (n, 3) cut into equal pieces of at most spacing_m: middles and half vectors of their chords."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    count = max(1, int(np.ceil(along[-1] / spacing_m - 1e-9)))
    at = np.linspace(0.0, along[-1], count + 1)
    points = np.column_stack([np.interp(at, along, chain[:, k]) for k in range(3)])
    return 0.5 * (points[:-1] + points[1:]), 0.5 * (points[1:] - points[:-1])


def crease_chains(ends: F64) -> tuple[list[F64], F64]:
    """Creases (n, 2, 3) joined into polylines that run straight on, and their tips: where they turn, branch or end."""
    if len(ends) == 0:
        return [], np.zeros((0, 3))
    keys, index, inverse = np.unique(
        nanometres(ends.reshape(-1, 3)), return_index=True, return_inverse=True
    )
    node = inverse.reshape(-1, 2)
    points = ends.reshape(-1, 3)[index]
    along = unit(ends[:, 1] - ends[:, 0])
    total = np.zeros((len(keys), 3))
    np.add.at(total, node[:, 0], along)
    np.add.at(total, node[:, 1], -along)
    degree = np.bincount(node.reshape(-1), minlength=len(keys))
    is_tip = (degree != 2) | (np.linalg.norm(total, axis=1) > TIP_TURN)
    beside: list[list[int]] = [[] for _ in keys]
    for edge, (a, b) in enumerate(node):
        beside[a].append(edge)
        beside[b].append(edge)
    free = np.ones(len(ends), bool)

    def walk(start: int, edge: int) -> F64:
        path, at = [start], start
        while True:
            free[edge] = False
            at = int(node[edge].sum() - at)
            path.append(at)
            onward = [e for e in beside[at] if free[e]]
            if is_tip[at] or not onward:
                return np.asarray(points[path])
            edge = onward[0]

    starts = [*np.flatnonzero(is_tip), *np.flatnonzero(~is_tip)]
    chains = [walk(int(n), e) for n in starts for e in beside[n] if free[e]]
    return chains, points[is_tip]


def _outward(surface: Surface, points: F64, step_m: float) -> F64:
    """Gradient of the distance at points on the surface, by central differences."""
    axes = np.eye(3) * step_m
    grad = np.empty_like(points)
    for k in range(3):
        high, _ = surface.signed_distance(points + axes[k])
        low, _ = surface.signed_distance(points - axes[k])
        grad[:, k] = high - low
    return grad
