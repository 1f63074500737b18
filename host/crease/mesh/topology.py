"""Connectivity of triangle meshes in numpy: welding, edges, orientation, holes, shells. Nothing warns or refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from crease.base.native import ffi, lib

Vertices = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int32]
Indices = npt.NDArray[np.int64]

ANGLE_SAME = 1e-9
"""Triangles round an edge that turn by less, in rad, lie on each other."""

TINY = 1e-300
"""What lengths are divided by that are zero."""

_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def weld(keys: npt.NDArray[np.float64]) -> tuple[Indices, Indices]:
    """Rows of `keys` (n, 3) that are equal: (first row of each kind, kind of each row).

    Kinds are numbered in order of their first row. Cost: one sort of n 64-bit hashes.
    """
    bits = (np.ascontiguousarray(keys) + 0.0).view(np.uint64).reshape(-1, 3)
    with np.errstate(over="ignore"):
        mixed = (bits ^ (bits >> np.uint64(29))) * _HASH
        mixed ^= mixed >> np.uint64(32)
        hashed = mixed[:, 0] + np.uint64(3) * mixed[:, 1] + np.uint64(7) * mixed[:, 2]
    _, first, kind = np.unique(hashed, return_index=True, return_inverse=True)
    if not np.array_equal(
        bits[first][kind], bits
    ):  # two hashes fell together: sort the rows themselves
        _, first, kind = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(first, kind="stable")
    number = np.empty(len(rank), dtype=np.int64)
    number[rank] = np.arange(len(rank))
    return first[rank], number[kind.reshape(-1)]


def compact(vertices: Vertices, triangles: Triangles) -> tuple[Vertices, Triangles]:
    """The same mesh without vertices that no triangle uses."""
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    number = np.cumsum(used, dtype=np.int64) - 1
    return vertices[used], number[triangles].astype(np.int32)


def directed_edges(triangles: Triangles) -> tuple[Indices, Indices]:
    """Start and end vertex of the 3 m edges; edge e belongs to triangle e // 3."""
    wide = triangles.astype(np.int64)
    return wide.reshape(-1), wide[:, [1, 2, 0]].reshape(-1)


def undirected_codes(triangles: Triangles, vertex_count: int) -> Indices:
    """One number for each of the 3 m edges, the same for both directions."""
    start, end = directed_edges(triangles)
    return np.minimum(start, end) * vertex_count + np.maximum(start, end)


def paired_edges(triangles: Triangles, vertex_count: int) -> tuple[Indices, Indices]:
    """Edges (of 3 m) that just two triangles share: those of the one, and in the same order those of the other."""
    codes = undirected_codes(triangles, vertex_count)
    order = np.argsort(codes, kind="stable")
    ranked = codes[order]
    starts = np.flatnonzero(np.r_[True, ranked[1:] != ranked[:-1]])
    pairs = starts[np.diff(np.r_[starts, len(codes)]) == 2]
    return order[pairs], order[pairs + 1]


def unbalanced_edges(triangles: Triangles, vertex_count: int) -> Indices:
    """Edges (of 3 m) whose direction occurs more often than its reverse. None: closed and consistently oriented."""
    start, end = directed_edges(triangles)
    forward = start * vertex_count + end
    # Sorted numbers alone take a fifth of the time, and most meshes are closed.
    if np.array_equal(np.sort(forward), np.sort(end * vertex_count + start)):
        return np.zeros(0, np.int64)
    codes, inverse, counts = np.unique(forward, return_inverse=True, return_counts=True)
    reverse = (codes % vertex_count) * vertex_count + codes // vertex_count
    place = np.searchsorted(codes, reverse)
    place[place == len(codes)] = 0
    balance = counts - np.where(codes[place] == reverse, counts[place], 0)
    return np.flatnonzero(balance[inverse] > 0)


def without_leaves(triangles: Triangles) -> Triangles:
    """The triangles, less those that lie on the back of another, and these."""
    low = np.argsort(triangles, axis=1)
    corners = np.take_along_axis(triangles, low, axis=1)
    # The order of the corners is a rotation of the sorted one, or it is turned.
    turned = np.where(((low[:, 1] - low[:, 0]) % 3) == 1, 1, -1)
    _, group = np.unique(corners, axis=0, return_inverse=True)
    group = group.reshape(-1)
    if len(group) == 0 or np.bincount(group).max() == 1:
        return triangles
    kept = np.ones(len(triangles), bool)
    for sign in (1, -1):
        mine = np.flatnonzero(turned == sign)
        order = mine[np.argsort(group[mine], kind="stable")]
        start = np.searchsorted(group[order], group[order], side="left")
        others = np.bincount(group[turned == -sign], minlength=int(group.max()) + 1)
        kept[order] = np.arange(len(order)) - start >= others[group[order]]
    return triangles[kept]


def touching(triangles: Triangles, vertex_count: int) -> npt.NDArray[np.bool_]:
    """Triangles (m,) with a corner where a closed surface touches itself: in an edge of more than two, or a vertex."""
    one, two = paired_edges(triangles, vertex_count)
    start, end = directed_edges(triangles)
    many = np.ones(len(start), bool)
    many[one] = many[two] = False
    shared = np.zeros(vertex_count, bool)
    shared[start[many]] = shared[end[many]] = True
    # Corners at a vertex hang together over its edges; where they do so in several parts, the surface touches there.
    _, _, vertex_of = _corner_parts(triangles, one, two)
    shared |= np.bincount(vertex_of, minlength=vertex_count) > 1
    return np.asarray(shared[triangles].any(axis=1))


def edge_use(triangles: Triangles, vertex_count: int) -> tuple[int, int]:
    """How many undirected edges have one triangle (boundary), and how many an odd number over two."""
    counts = np.unique(undirected_codes(triangles, vertex_count), return_counts=True)[1]
    return int(np.count_nonzero(counts == 1)), int(
        np.count_nonzero((counts > 2) & (counts % 2 == 1))
    )


def areas_m2(vertices: Vertices, triangles: Triangles) -> npt.NDArray[np.float64]:
    """Area of each triangle, (m,)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    length: npt.NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return 0.5 * length


def altitudes_m(vertices: Vertices, triangles: Triangles) -> npt.NDArray[np.float64]:
    """Least altitude of each triangle, (m,)."""
    corners = vertices[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    altitude: npt.NDArray[np.float64] = (
        2.0 * areas_m2(vertices, triangles) / np.where(sides > 0.0, sides, 1.0)
    )
    return altitude


def volumes_m3(vertices: Vertices, triangles: Triangles) -> npt.NDArray[np.float64]:
    """Signed volume under each triangle as seen from the centre of the box, (m,)."""
    centred = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    a, b, c = (centred[triangles[:, k]] for k in range(3))
    volume: npt.NDArray[np.float64] = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return volume


def shells(vertices: Vertices, triangles: Triangles) -> tuple[int, npt.NDArray[np.int32]]:
    """Number of connected shells of a closed mesh, and the shell of each triangle.

    Where more than two triangles meet in an edge, those are neighbours that enclose material between them: two solids
    that touch along an edge or a face are two shells, also where one of them is inside out.
    """
    one, two = (edges // 3 for edges in solid_edges(vertices, triangles))
    graph = sparse.coo_matrix(
        (np.ones(len(one), dtype=np.int8), (one, two)), shape=(len(triangles), len(triangles))
    )
    count, of_triangle = csgraph.connected_components(graph, directed=False)
    return int(count), of_triangle.astype(np.int32)


def solid_edges(vertices: Vertices, triangles: Triangles) -> tuple[Indices, Indices]:
    """Edges (of 3 m) of a closed mesh that belong together: those of the one, and in the same order those of the other.

    Where more than two triangles meet in an edge, those belong together that enclose material between them.
    """
    codes = undirected_codes(triangles, len(vertices))
    order = np.argsort(codes, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(codes[order]) != 0])
    uses = np.diff(np.r_[starts, len(codes)])
    plain = starts[uses == 2]
    one, two = order[plain], order[plain + 1]
    crowded = [order[s : s + n] for s, n in zip(starts[uses > 2], uses[uses > 2], strict=True)]
    extra = [pair for edges in crowded for pair in _neighbours_at(vertices, triangles, edges)]
    if extra:
        one, two = np.r_[one, [p[0] for p in extra]], np.r_[two, [p[1] for p in extra]]
    return one, two


def parted(vertices: Vertices, triangles: Triangles) -> tuple[Vertices, Triangles]:
    """The same closed mesh with a vertex for each part where it touches itself: all edges have two triangles."""
    one, two = solid_edges(vertices, triangles)
    _, part, vertex_of = _corner_parts(triangles, one, two)
    if np.bincount(vertex_of).max() == 1:
        return vertices, triangles
    return vertices[vertex_of], part.reshape(-1, 3).astype(np.int32)


def _corner_parts(
    triangles: Triangles, one: Indices, two: Indices
) -> tuple[int, npt.NDArray[np.int32], Indices]:
    """Corners (3 m) that hang together at a vertex over pairs of edges: number of parts, each one's, their vertices."""
    # Two triangles pass an edge in opposite directions: the start of the one is the end of the other.
    after = (one // 3) * 3 + (one + 1) % 3, (two // 3) * 3 + (two + 1) % 3
    rows, columns = np.r_[one, after[0]], np.r_[after[1], two]
    links = sparse.coo_matrix(
        (np.ones(len(rows), np.int8), (rows, columns)), shape=(triangles.size,) * 2
    )
    count, part = csgraph.connected_components(links, directed=False)
    vertex_of = np.zeros(count, np.int64)
    vertex_of[part] = triangles.reshape(-1)
    return int(count), part, vertex_of


def _neighbours_at(
    vertices: Vertices, triangles: Triangles, edges: Indices
) -> list[tuple[int, int]]:
    """Pairs of edges (of 3 m) with material between their triangles, among those that lie on each other."""
    faces, side = edges // 3, edges % 3
    tail, head = triangles[faces, side], triangles[faces, (side + 1) % 3]
    tip = triangles[faces, (side + 2) % 3]
    forward = tail < head
    axis = vertices[max(tail[0], head[0])] - vertices[min(tail[0], head[0])]
    axis = axis / max(float(np.linalg.norm(axis)), TINY)
    out = vertices[tip] - vertices[tail]
    out = out - np.outer(out @ axis, axis)
    length = np.linalg.norm(out, axis=1)
    first = out[np.argmax(length)] / max(float(length.max()), TINY)
    angle = np.arctan2(out @ np.cross(axis, first), out @ first)
    # Material lies on the falling side of a forward triangle. On that way forward and backward ones nest as brackets
    # do, those that lie on each other first the backward one: nothing lies between them.
    fall = np.round(-angle / ANGLE_SAME) % np.round(2.0 * np.pi / ANGLE_SAME)
    order = np.lexsort((forward, fall))
    depth = np.cumsum(np.where(forward[order], 1, -1))
    pairs, opened = [], []
    for i in np.roll(order, -int(np.argmin(depth)) - 1).tolist():
        if forward[i]:
            opened.append(int(edges[i]))
        elif opened:
            pairs.append((opened.pop(), int(edges[i])))
    return pairs


def _paired_faces(
    triangles: Triangles, vertex_count: int
) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Triangles that share an edge of exactly two, and whether both run along it the same way (one is flipped)."""
    one, two = paired_edges(triangles, vertex_count)
    start, _ = directed_edges(triangles)
    return one // 3, two // 3, start[one] == start[two]


def orient(triangles: Triangles, vertex_count: int) -> tuple[Triangles, int]:
    """Turn triangles so that neighbours agree; the fewer of each connected piece are turned.

    Output: triangles, and how many were turned.   Cost: 2 s for a million triangles.
    """
    one, two, same = _paired_faces(triangles, vertex_count)
    count = len(triangles)
    weight = np.where(same, 2, 1).astype(np.int8)
    graph = sparse.coo_matrix((weight, (one, two)), shape=(count, count))
    # Two triangles that share two edges add up; such a pair is closed in itself and either weight will do.
    graph.sum_duplicates()
    graph = (graph + graph.T).tocsr()
    _, piece = csgraph.connected_components(graph, directed=False)
    flip = _flips_along_trees(graph, piece, count)
    turned = np.bincount(piece, weights=flip)
    total = np.bincount(piece)
    flip ^= (2.0 * turned > total)[piece]
    result = triangles.copy()
    result[flip] = result[flip][:, ::-1]
    return result, int(np.count_nonzero(flip))


def _flips_along_trees(
    graph: Any, piece: npt.NDArray[np.int32], count: int
) -> npt.NDArray[np.bool_]:
    """Parity of every triangle against the root of its piece, by one search from a node that knows all roots."""
    _, roots = np.unique(piece, return_index=True)
    edges = graph.tocoo()
    whole = sparse.coo_matrix(
        (
            np.r_[edges.data, np.ones(len(roots), edges.data.dtype)],
            (np.r_[edges.row, np.full(len(roots), count)], np.r_[edges.col, roots]),
        ),
        shape=(count + 1, count + 1),
    ).tocsr()
    order, before = csgraph.breadth_first_order(whole, count, directed=True)
    children = order[1:]
    parents = before[children]
    odd = (np.asarray(whole[parents, children]).reshape(-1) == 2).tolist()
    state = [False] * (count + 1)
    for child, parent, change in zip(children.tolist(), parents.tolist(), odd, strict=True):
        state[child] = state[parent] ^ change
    return np.array(state[:count], dtype=bool)


def boundary_loops(triangles: Triangles, vertex_count: int) -> list[list[int]] | None:
    """Rims of the holes of an oriented mesh, wound so that a cap with this winding closes it.

    Output: None when the rims branch (two holes meet in a vertex).
    """
    start, end = directed_edges(triangles)
    open_edges = unbalanced_edges(triangles, vertex_count)
    following: dict[int, int] = {}
    for tail, head in zip(start[open_edges].tolist(), end[open_edges].tolist(), strict=True):
        if head in following:
            return None
        following[head] = tail
    loops = []
    while following:
        first, at = next(iter(following.items()))
        loop = [first]
        del following[first]
        while at != first:
            if at not in following:
                return None
            loop.append(at)
            at = following.pop(at)
        loops.append(loop)
    return loops


def crossing_pairs(
    vertices: Vertices, triangles: Triangles, tolerance_m: float
) -> npt.NDArray[np.int32]:
    """Pairs of triangles that pass through each other, (n, 2).

    Passages shallower than `tolerance_m`, overlaps inside one plane and pairs that share an edge are not seen.
    Cost: 1 s for a million triangles.
    """
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    corners = np.ascontiguousarray(triangles, dtype=np.int32)
    room = 1024
    while True:
        pairs = np.empty((room, 2), np.int32)
        count = lib.cr_mesh_self_intersections(
            ffi.from_buffer("double[]", points),
            ffi.from_buffer("int32_t[]", corners),
            len(corners),
            tolerance_m,
            ffi.from_buffer("int32_t[]", pairs.reshape(-1)),
            room,
        )
        if count < 0:
            raise MemoryError
        if count <= room:
            return pairs[:count]
        room = int(count)


def self_intersections(
    vertices: Vertices, triangles: Triangles, tolerance_m: float
) -> tuple[int, tuple[int, int]]:
    """Number of pairs of triangles that pass through each other, and one of them; see crossing_pairs."""
    pairs = crossing_pairs(vertices, triangles, tolerance_m)
    one, other = pairs[-1].tolist() if len(pairs) else (-1, -1)
    return len(pairs), (one, other)
