"""Open surfaces made closed: gaps sewn, vertices on edges taken in, openings capped, sheets given a thickness."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from crease.mesh import topology
from crease.mesh.topology import Triangles, Vertices

F64 = npt.NDArray[np.float64]

FOLD = 0.5
"""Cosine between two triangles at one edge, seen along it, from which on they lie on each other when both are wound the
same way: a copy of a surface, a little beside it, is no part of it that goes on behind a gap. Sewn to its rim it would
leave nothing between the two. Knives and thin walls are wound in opposite ways."""

BOW_SHARE = 0.2
"""How far a rim may leave its plane, as a share of the square root of its area, to be capped as a polygon."""


@dataclass(frozen=True)
class Cap:
    """Triangles over a rim. Shapes: points_m (0 or 1, 3) a new vertex, which triangles number `vertex count`; area."""

    points_m: F64
    triangles: Triangles
    area_m2: float
    middle_m: F64


def sew(vertices: Vertices, triangles: Triangles, reach_m: float) -> tuple[Triangles, int]:
    """Ends of open edges within reach of each other become one vertex.

    Output: triangles, some perhaps with two equal corners, and how many vertices were moved.
    """
    start, end = topology.directed_edges(triangles)
    loose_edges = topology.unbalanced_edges(triangles, len(vertices))
    loose = np.unique(np.r_[start[loose_edges], end[loose_edges]])
    if len(loose) == 0:
        return triangles, 0
    pairs = cKDTree(vertices[loose]).query_pairs(reach_m, output_type="ndarray")
    if len(pairs) == 0:
        return triangles, 0
    graph = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(loose), len(loose)))
    _, group = csgraph.connected_components(graph, directed=False)
    _, leader = np.unique(group, return_index=True)
    target = np.arange(len(vertices))
    target[loose] = loose[leader[group]]
    _keep_folded_apart(vertices, triangles, loose_edges, target)
    moved = int(np.count_nonzero(target != np.arange(len(vertices))))
    return target[triangles].astype(np.int32), moved


def _inward(
    vertices: Vertices, triangles: Triangles, edges: npt.NDArray[np.int64]
) -> tuple[F64, F64]:
    """Of edges (indices into 3 m): their direction, and across it to the third corner of the triangle; unit, (n, 3)."""
    start, end = topology.directed_edges(triangles)
    tail = vertices[start[edges]]
    along = vertices[end[edges]] - tail
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    inward = vertices[triangles[edges // 3, (edges + 2) % 3]] - tail
    inward = inward - np.einsum("nx,nx->n", inward, along)[:, None] * along
    return along, inward / np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-300)


def _keep_folded_apart(
    vertices: Vertices,
    triangles: Triangles,
    edges: npt.NDArray[np.int64],
    target: npt.NDArray[np.int64],
) -> None:
    """Takes back what of a sewing (target of each vertex) would make one edge of two with triangles on each other."""
    start, end = topology.directed_edges(triangles)
    tail, head = start[edges], end[edges]
    _, inward = _inward(vertices, triangles, edges)
    count = len(vertices)
    own = np.minimum(tail, head) * count + np.maximum(tail, head)
    while True:
        low, high = np.minimum(target[tail], target[head]), np.maximum(target[tail], target[head])
        code = np.where(low == high, -1 - np.arange(len(edges)), low * count + high)
        order = np.argsort(code, kind="stable")
        one, two = order[:-1], order[1:]
        fold = (code[one] == code[two]) & (own[one] != own[two])
        fold &= target[tail[one]] == target[tail[two]]
        fold &= np.einsum("nx,nx->n", inward[one], inward[two]) > FOLD
        apart = np.unique(np.concatenate([e[k[fold]] for e in (tail, head) for k in (one, two)]))
        if len(apart) == 0 or (target[apart] == apart).all():
            return
        target[apart] = apart


def split_edges(vertices: Vertices, triangles: Triangles, reach_m: float) -> tuple[Triangles, int]:
    """Open edges on which vertices of other open edges lie are cut there.

    Output: triangles, and how many vertices were taken in.
    """
    start, end = topology.directed_edges(triangles)
    open_edges = topology.unbalanced_edges(triangles, len(vertices))
    loose = np.unique(np.r_[start[open_edges], end[open_edges]])
    if len(loose) == 0:
        return triangles, 0
    cuts: dict[int, list[tuple[int, list[int]]]] = defaultdict(list)
    edge, on = _vertices_on(vertices, loose, start[open_edges], end[open_edges], reach_m)
    folded = _on_folds(vertices, triangles, open_edges, edge, on)
    edge, on = edge[~folded], on[~folded]
    taken = len(on)
    if taken == 0:
        return triangles, 0
    bounds = np.flatnonzero(np.diff(edge)) + 1
    for part in np.split(np.arange(taken), bounds):
        side = int(open_edges[edge[part[0]]])
        cuts[side // 3].append((side % 3, on[part].tolist()))
    whole = np.ones(len(triangles), bool)
    whole[list(cuts)] = False
    pieces = [piece for t, sides in cuts.items() for piece in _fan(triangles[t], sides, vertices)]
    return np.concatenate([triangles[whole], np.array(pieces, np.int32)]), taken


def _on_folds(
    vertices: Vertices,
    triangles: Triangles,
    edges: npt.NDArray[np.int64],
    edge: npt.NDArray[np.int64],
    on: npt.NDArray[np.int64],
) -> npt.NDArray[np.bool_]:
    """Which vertices `on` edges[edge] end an open edge along it, wound alike, with triangles on each other."""
    start, end = topology.directed_edges(triangles)
    along, inward = _inward(vertices, triangles, edges)
    ends = np.concatenate([start[edges], end[edges]])
    owner = np.tile(np.arange(len(edges)), 2)
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], on)
    many = np.searchsorted(ends[order], on, side="right") - first
    asked = np.repeat(np.arange(len(on)), many)
    rank = np.arange(len(asked)) - np.repeat(np.cumsum(many) - many, many)
    other = owner[order][np.repeat(first, many) + rank]
    beside = np.einsum("nx,nx->n", along[edge[asked]], along[other]) > FOLD
    beside &= np.einsum("nx,nx->n", inward[edge[asked]], inward[other]) > FOLD
    return np.bincount(asked, weights=beside, minlength=len(on)) > 0


def is_apart(vertices: Vertices, triangles: Triangles, reach_m: float) -> bool:
    """Whether neither `sew` nor `split_edges` would find anything, with this reach or with less."""
    start, end = topology.directed_edges(triangles)
    open_edges = topology.unbalanced_edges(triangles, len(vertices))
    loose = np.unique(np.r_[start[open_edges], end[open_edges]])
    # A vertex on an edge that is too near its end to be taken in is that near to the end.
    if len(loose) == 0 or len(
        cKDTree(vertices[loose]).query_pairs(2.0 * reach_m, output_type="ndarray")
    ):
        return len(loose) == 0
    edge, _ = _vertices_on(vertices, loose, start[open_edges], end[open_edges], reach_m)
    return len(edge) == 0


def _vertices_on(
    vertices: Vertices,
    loose: npt.NDArray[np.int64],
    start: npt.NDArray[np.int64],
    end: npt.NDArray[np.int64],
    reach_m: float,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Loose vertices that lie on edges (n,): places of the edges, and the vertices, edge by edge from start to end."""
    along = vertices[end] - vertices[start]
    length = np.linalg.norm(along, axis=1)
    long = np.flatnonzero(length > 2.0 * reach_m)
    middle = 0.5 * (vertices[start[long]] + vertices[end[long]])
    near = cKDTree(vertices[loose]).query_ball_point(middle, 0.5 * length[long])
    edge = np.repeat(long, [len(found) for found in near])
    if len(edge) == 0:
        return edge, edge
    other = loose[np.concatenate([np.asarray(found, np.int64) for found in near])]
    own = (other == start[edge]) | (other == end[edge])
    edge, other = edge[~own], other[~own]
    away = vertices[other] - vertices[start[edge]]
    part = np.einsum("nx,nx->n", away, along[edge]) / length[edge] ** 2
    off = np.linalg.norm(away - part[:, None] * along[edge], axis=1)
    on = (off <= reach_m) & (part * length[edge] > reach_m)
    on &= (1.0 - part) * length[edge] > reach_m
    edge, other, part = edge[on], other[on], part[on]
    order = np.lexsort((part, edge))
    return edge[order], other[order]


def _fan(
    triangle: npt.NDArray[np.int32], sides: Sequence[tuple[int, list[int]]], vertices: Vertices
) -> list[tuple[int, int, int]]:
    """A triangle with more vertices on its sides, cut up: ears of the largest least height first."""
    extra = dict(sides)
    rim = [v for k in range(3) for v in (int(triangle[k]), *extra.get(k, []))]
    pieces = []
    while len(rim) > 3:
        corners = vertices[
            np.array([(rim[i - 1], rim[i], rim[(i + 1) % len(rim)]) for i in range(len(rim))])
        ]
        area = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        i = int(np.argmax(area / np.maximum(side, 1e-300)))
        pieces.append((rim[i - 1], rim[i], rim[(i + 1) % len(rim)]))
        del rim[i]
    return [*pieces, (rim[0], rim[1], rim[2])]


def components(triangles: Triangles, vertex_count: int) -> tuple[int, npt.NDArray[np.int32]]:
    """Pieces of surface joined over edges, however many triangles meet there: number, and piece of each triangle."""
    codes = topology.undirected_codes(triangles, vertex_count)
    _, edge = np.unique(codes, return_inverse=True)
    count, owner = len(triangles), np.arange(len(codes)) // 3
    graph = sparse.coo_matrix(
        (np.ones(len(owner), np.int8), (owner, count + edge.reshape(-1))),
        shape=(count + len(codes), count + len(codes)),
    )
    _, piece = csgraph.connected_components(graph, directed=False)
    _, piece = np.unique(piece[:count], return_inverse=True)
    return int(piece.max()) + 1, piece.reshape(-1).astype(np.int32)


def rims(triangles: Triangles, vertex_count: int) -> list[list[int]]:
    """The boundary of oriented triangles as simple loops, wound so that caps of the same winding close them.

    Edges that are missing several times come as often. Any triangles have such loops: what goes into a vertex
    comes out.
    """
    start, end = topology.directed_edges(triangles)
    low, high = np.minimum(start, end), np.maximum(start, end)
    codes, edge = np.unique(low * vertex_count + high, return_inverse=True)
    net = np.bincount(edge.reshape(-1), weights=np.where(start < end, 1, -1)).astype(int)
    onward: dict[int, list[int]] = defaultdict(list)
    for code, surplus in zip(codes[net != 0].tolist(), net[net != 0].tolist(), strict=True):
        a, b = code // vertex_count, code % vertex_count
        tail, head = (b, a) if surplus > 0 else (a, b)
        onward[tail].extend([head] * abs(surplus))
    loops = []
    for first in sorted(onward):
        while onward[first]:
            loops.extend(_loops_from(first, onward))
    return loops


def _loops_from(first: int, onward: dict[int, list[int]]) -> list[list[int]]:
    """A walk until it comes back to its start, cut into loops wherever it meets itself."""
    loops: list[list[int]] = []
    path, place = [first], {first: 0}
    while True:
        at = onward[path[-1]].pop()
        if at in place:
            loop = path[place[at] :]
            for v in loop[1:]:
                del place[v]
            del path[place[at] + 1 :]
            loops.append(loop)
            if at == first:
                return loops
            continue
        place[at] = len(path)
        path.append(at)


def least_cap_m2(vertices: Vertices, loop: Sequence[int]) -> float:
    """The area that any surface over a rim has at least: that of its shadow along its mean normal."""
    rim = vertices[list(loop)]
    rim = rim - rim.mean(axis=0)
    return float(0.5 * np.linalg.norm(np.cross(rim, np.roll(rim, -1, axis=0)).sum(axis=0)))


def cap(vertices: Vertices, loop: Sequence[int]) -> Cap:
    """Triangles over a rim: a polygon when it is nearly plane, else a fan round its middle."""
    rim = vertices[list(loop)]
    flat = polygon_cap(vertices, loop)
    if flat is not None:
        area = float(topology.areas_m2(vertices, flat).sum())
        return Cap(np.zeros((0, 3)), flat, area, rim.mean(axis=0))
    length = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1)
    weight = length + np.roll(length, 1)
    middle = (weight[:, None] * rim).sum(axis=0) / max(float(weight.sum()), 1e-300)
    number = np.asarray(loop, np.int32)
    fan = np.column_stack(
        [number, np.roll(number, -1), np.full(len(number), len(vertices), np.int32)]
    ).astype(np.int32)
    area = float(topology.areas_m2(np.vstack([vertices, middle]), fan).sum())
    return Cap(middle[None], fan, area, rim.mean(axis=0))


def polygon_cap(vertices: Vertices, loop: Sequence[int]) -> Triangles | None:
    """Triangles over a rim, or None when it is too far from a plane to be seen as a polygon."""
    from manifold3d import triangulate

    rim = vertices[list(loop)]
    centred = rim - rim.mean(axis=0)
    normal = 0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(normal))
    if size <= 0.0:
        return None
    normal /= size
    if np.abs(centred @ normal).max() > BOW_SHARE * np.sqrt(size):
        return None
    across = np.linalg.svd(centred - np.outer(centred @ normal, normal), full_matrices=False)[2][0]
    flat = np.ascontiguousarray(
        np.stack([centred @ across, centred @ np.cross(normal, across)], axis=1)
    )
    pieces = np.asarray(triangulate([flat]))
    if len(pieces) != len(loop) - 2:
        return None
    number = np.asarray(loop, dtype=np.int32)
    triangles: Triangles = number[pieces.reshape(-1, 3)]
    return triangles


def leaves(triangles: Triangles, vertex_count: int) -> list[Triangles]:
    """The parts of a sheet between its seams, edges of more than two triangles: no side is the outer one there."""
    one, two = topology.paired_edges(triangles, vertex_count)
    graph = sparse.coo_matrix(
        (np.ones(len(one), np.int8), (one // 3, two // 3)), shape=(len(triangles),) * 2
    )
    _, leaf = csgraph.connected_components(graph, directed=False)
    order = np.argsort(leaf, kind="stable")
    return np.split(triangles[order], np.cumsum(np.bincount(leaf))[:-1])


def thicken(
    vertices: Vertices, triangles: Triangles, thickness_m: float
) -> tuple[Vertices, Triangles]:
    """A sheet as a solid: half the thickness to either side along the vertex normals, and walls over its rims."""
    points, corners = topology.compact(vertices, triangles)
    face = np.cross(
        points[corners[:, 1]] - points[corners[:, 0]], points[corners[:, 2]] - points[corners[:, 0]]
    )
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, corners[:, k], face)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    count = len(points)
    start, end = topology.directed_edges(corners)
    low, high = np.minimum(start, end), np.maximum(start, end)
    codes, edge = np.unique(low * count + high, return_inverse=True)
    net = np.bincount(edge.reshape(-1), weights=np.where(start < end, 1, -1)).astype(int)
    a, b = codes[net != 0] // count, codes[net != 0] % count
    forward = net[net != 0] > 0
    tail, head = np.where(forward, a, b), np.where(forward, b, a)
    walls = np.concatenate(
        [
            np.column_stack([head, tail, tail + count]),
            np.column_stack([head, tail + count, head + count]),
        ]
    )
    both = np.concatenate(
        [points + 0.5 * thickness_m * normal, points - 0.5 * thickness_m * normal]
    )
    return both, np.concatenate([corners, corners[:, ::-1] + count, walls]).astype(np.int32)
