"""Covers of a polyhedron by convex pieces, found once from its planes; independent of the project.

A piece is a largest set of planes that are pairwise related (they share convex creases only, or each lies below the
other) and hang together by creases, and whose intersection stays inside the solid. Pieces overlap. Units: mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d as mf
import networkx as nx
import numpy as np
from numpy.typing import NDArray
from overlap import CREASE_DEG, Solid, _edge_pairs

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# A corner this far above a plane lies on it: what float32 leaves of a plane.
ON_PLANE_MM = 2e-4
# A piece may leave the solid by this share of its volume: slivers of the same rounding.
OUTSIDE_SHARE = 1e-5


@dataclass(frozen=True)
class Piece:
    """Planes n.x <= offset: normals (c, 3), offsets (c,), the smooth surface each belongs to (c,); box of the solid."""

    normals: Floats
    offsets: Floats
    surface: Ints
    low: Floats
    high: Floats


@dataclass(frozen=True)
class _Planes:
    """Planes of a solid: normals and offsets, planes that meet, and smooth surfaces; edges as (plane, plane, turn)."""

    normals: Floats
    offsets: Floats
    corners: Floats
    group: Ints
    edges: tuple[Ints, Ints, Floats]
    surface: Ints

    def related(self) -> NDArray[np.bool_]:
        """(g, g): by the label of the crease where two planes meet, else each below the other."""
        count = len(self.offsets)
        height = np.full((count, count), -np.inf)
        for g in range(count):
            over = self.corners @ self.normals[g] - self.offsets[g]
            np.maximum.at(height[g], self.group, over.max(axis=1))
        table = (height < ON_PLANE_MM) & (height.T < ON_PLANE_MM)
        a, b, turn = self.edges
        table[a[turn > 0.0], b[turn > 0.0]] = True
        table[b[turn > 0.0], a[turn > 0.0]] = True
        table[a[turn < 0.0], b[turn < 0.0]] = False
        table[b[turn < 0.0], a[turn < 0.0]] = False
        return np.asarray(table, bool)


def _graph(count: int, a: Ints, b: Ints) -> nx.Graph:
    graph = nx.Graph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(zip(a.tolist(), b.tolist(), strict=True))
    return graph


def _planes(solid: Solid) -> _Planes:
    mesh = solid.body.to_mesh64()
    faces, group = np.asarray(mesh.tri_verts, np.int64), np.asarray(mesh.face_id, np.int64)
    points = np.asarray(mesh.vert_properties[:, :3], float)
    count = len(solid.normals)
    corners = points[faces]
    offsets = np.full(count, -np.inf)
    reach = np.einsum("ijk,ik->ij", corners, solid.normals[group]).max(axis=1)
    np.maximum.at(offsets, group, reach)
    a, b, tail, head = _edge_pairs(faces, len(points))
    ga, gb = group[a], group[b]
    na, nb = solid.normals[ga], solid.normals[gb]
    turn = np.einsum("ij,ij->i", np.cross(na, nb), points[head] - points[tail])
    smooth = np.einsum("ij,ij->i", na, nb) > np.cos(np.radians(CREASE_DEG))
    surface = np.zeros(count, np.int64)
    for label, members in enumerate(nx.connected_components(_graph(count, ga[smooth], gb[smooth]))):
        surface[list(members)] = label
    apart = ga != gb
    edges = (ga[apart], gb[apart], turn[apart])
    return _Planes(solid.normals, offsets, corners, group, edges, surface)


def _outside_share(solid: Solid, normals: Floats, offsets: Floats) -> float:
    """Share of the volume of a piece, cut to the solid's box, that is outside the solid."""
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    body = mf.Manifold.cube((high - low).tolist()).translate(low.tolist())
    for normal, offset in zip(normals, offsets, strict=True):
        body = body.trim_by_plane((-normal).tolist(), -float(offset))
    volume = body.volume()
    return float((body - solid.body).volume() / volume) if volume > 0.0 else 1.0


def cover(solid: Solid) -> list[Piece]:
    """Convex pieces of a solid. Errors: ValueError if they leave some of it uncovered."""
    planes = _planes(solid)
    box = planes.corners.min(axis=(0, 1)), planes.corners.max(axis=(0, 1))
    whole = Piece(planes.normals, planes.offsets, planes.surface, *box)
    if solid.body.hull().volume() - solid.body.volume() < OUTSIDE_SHARE * solid.body.volume():
        return [whole]
    count = len(planes.offsets)
    meet = _graph(count, *planes.edges[:2])
    first, second = np.nonzero(np.triu(planes.related(), 1))
    sets = {
        frozenset(part)
        for clique in nx.find_cliques(_graph(count, first, second))
        for part in nx.connected_components(meet.subgraph(clique))
    }
    pieces = []
    for members in sorted(map(sorted, sets)):
        normals, offsets = whole.normals[members], whole.offsets[members]
        piece = Piece(normals, offsets, whole.surface[members], whole.low, whole.high)
        if _outside_share(solid, piece.normals, piece.offsets) < OUTSIDE_SHARE:
            pieces.append((frozenset(members), piece))
    kept = [p for s, p in pieces if not any(s < other for other, _ in pieces)]
    _check_covered(solid, kept)
    return kept


def _check_covered(solid: Solid, pieces: list[Piece]) -> None:
    left = solid.body
    for piece in pieces:
        inside = left
        for normal, offset in zip(piece.normals, piece.offsets, strict=True):
            inside = inside.trim_by_plane((-normal).tolist(), -float(offset))
        left = left - inside
    if left.volume() > OUTSIDE_SHARE * solid.body.volume():
        raise ValueError(f"{left.volume():.3g} mm^3 of the solid lie in no convex piece")
