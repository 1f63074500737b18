"""Exact contact of two closed meshes from their boolean intersection; independent of the project.

Units: mm, mm^2, mm^3; forces are divided by the stiffness (mm of penetration), torques too (mm^2).
The definitions are in README.md beside this file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import manifold3d as mf
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CREASE_DEG = 30.0
# Components below this volume are slivers of rounding: a cube of 0.01 mm.
SLIVER_MM3 = 1e-6
# Coplanar triangles are merged before the booleans: float32 leaves planes this uneven. Curved
# surfaces stay as they are.
FLAT_MM = 2e-5
FLAT_DEG = 0.02
# An area whose normals cancel to this share of its surface has no direction, hence no force.
CANCEL_SHARE = 1e-9
# Slack of the cut behind a zone's plane, so that the plane itself stays in.
TRIM_MM = 1e-7

_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Solid:
    """A closed solid: `ident` marks its triangles, `normals` (groups, 3) its coplanar groups."""

    body: mf.Manifold
    ident: int
    normals: Floats
    vertices: Floats


@dataclass(frozen=True)
class Area:
    """One contact area: unit normal (3,), depth, point of action (3,), touched static surface."""

    normal: Floats
    depth_mm: float
    point_mm: Floats
    touched_mm2: float


def read_stl(path: Path) -> tuple[Floats, Ints]:
    """Welded vertices (n, 3) mm and faces (m, 3) of a binary STL."""
    corners = np.fromfile(path, dtype=_STL, offset=84)["corners"].reshape(-1, 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return vertices.astype(float), np.asarray(index, np.int64).reshape(-1, 3)


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    """Normal times area of each triangle, (m, 3) mm^2."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _edge_pairs(faces: Ints, count: int) -> tuple[Ints, Ints, Ints, Ints]:
    """Edges of a closed mesh, (e,) each: its two triangles, its ends as directed in the first."""
    tri = np.tile(np.arange(len(faces)), 3)
    tail = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
    head = np.concatenate([faces[:, 1], faces[:, 2], faces[:, 0]])
    up = tail < head
    forward, backward = np.flatnonzero(up), np.flatnonzero(~up)
    forward = forward[np.argsort(tail[forward] * count + head[forward], kind="stable")]
    backward = backward[np.argsort(head[backward] * count + tail[backward], kind="stable")]
    return tri[forward], tri[backward], tail[forward], head[forward]


def _label(count: int, a: Ints, b: Ints) -> tuple[int, Ints]:
    """Connected components of `count` nodes with links a-b: number, label per node."""
    links = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    number, labels = connected_components(links, directed=False)
    return int(number), np.asarray(labels, np.int64)


def make_solid(vertices: Floats, faces: Ints) -> Solid:
    """A solid whose coplanar triangles are merged and labelled by coplanar group."""
    raw = mf.Manifold(mf.Mesh64(vertices, faces.astype(np.uint64)))
    if raw.status() != mf.Error.NoError:
        raise ValueError(f"not a closed mesh: {raw.status()}")
    slim = raw.simplify(FLAT_MM).to_mesh64()
    points = np.array(slim.vert_properties[:, :3], float, order="C")
    tri = np.array(slim.tri_verts, np.int64, order="C")
    vectors = _area_vectors(points, tri)
    unit = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
    a, b, _, _ = _edge_pairs(tri, len(points))
    flat = np.einsum("ij,ij->i", unit[a], unit[b]) > np.cos(np.radians(FLAT_DEG))
    groups, label = _label(len(tri), a[flat], b[flat])
    normals = np.zeros((groups, 3))
    np.add.at(normals, label, vectors)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ident = mf.Manifold.reserve_ids(1)
    labelled = mf.Mesh64(
        points,
        tri.astype(np.uint64),
        run_index=np.array([0, 3 * len(tri)], np.uint64),
        run_original_id=np.array([ident], np.uint32),
        face_id=label.astype(np.uint64),
    )
    return Solid(mf.Manifold(labelled), ident, normals, points)


@dataclass(frozen=True)
class _Component:
    """One connected piece of the overlap, split by origin of its triangles."""

    points: Floats
    faces: Ints
    vectors: Floats
    is_static: NDArray[np.bool_]
    group: Ints


def _component(piece: mf.Manifold, static_ident: int) -> _Component:
    mesh = piece.to_mesh64()
    faces = np.asarray(mesh.tri_verts, np.int64)
    points = np.asarray(mesh.vert_properties[:, :3], float)
    is_static = np.zeros(len(faces), dtype=bool)
    bounds = np.asarray(mesh.run_index, np.int64) // 3
    for run, ident in enumerate(np.asarray(mesh.run_original_id)):
        is_static[bounds[run] : bounds[run + 1]] = ident == static_ident
    vectors = _area_vectors(points, faces)
    return _Component(points, faces, vectors, is_static, np.asarray(mesh.face_id, np.int64))


@dataclass(frozen=True)
class _Zones:
    """Contact zones of a component: faces per zone and creases between zones, each (e, 2)."""

    count: int
    of_face: Ints
    convex: Ints
    concave: Ints


def _find_zones(part: _Component, normals: Floats) -> _Zones:
    """Smoothly connected sets of the static's triangles, linked by convex and concave creases."""
    a, b, tail, head = _edge_pairs(part.faces, len(part.points))
    both = part.is_static[a] & part.is_static[b]
    a, b, tail, head = a[both], b[both], tail[both], head[both]
    na, nb = normals[part.group[a]], normals[part.group[b]]
    smooth = np.einsum("ij,ij->i", na, nb) > np.cos(np.radians(CREASE_DEG))
    ids = np.flatnonzero(part.is_static)
    place = np.full(len(part.faces), -1, dtype=np.int64)
    place[ids] = np.arange(len(ids))
    count, label = _label(len(ids), place[a[smooth]], place[b[smooth]])
    of_face = np.full(len(part.faces), -1, dtype=np.int64)
    of_face[ids] = label
    turn = np.einsum("ij,ij->i", np.cross(na, nb), part.points[head] - part.points[tail])
    pairs = np.column_stack([of_face[a], of_face[b]])
    apart = ~smooth & (pairs[:, 0] != pairs[:, 1])
    return _Zones(count, of_face, pairs[apart & (turn > 0.0)], pairs[apart & (turn < 0.0)])


def _memberships(zones: _Zones, touched: Floats) -> Floats:
    """Share of every zone in every area, (areas, zones); columns sum to 1.

    Without a concave crease all zones make one area. With one, zones joined by convex creases make
    an area, unless a concave crease lies inside such a set (a mixed corner): then see _divided.
    """
    if not len(zones.concave):
        return np.ones((1, zones.count))
    number, label = _label(zones.count, zones.convex[:, 0], zones.convex[:, 1])
    within = label[zones.concave[:, 0]] == label[zones.concave[:, 1]]
    mixed = {int(m) for m in label[zones.concave[within, 0]]}
    rows = []
    for joined in range(number):
        members = label == joined
        if joined in mixed:
            leaders = np.unique(zones.concave[within])
            rows += list(_divided(zones, touched, leaders[members[leaders]]) * members)
        else:
            rows.append(members.astype(float))
    return np.array(rows)


def _divided(zones: _Zones, touched: Floats, leaders: Ints) -> Floats:
    """Shares in a convexly joined set with concave creases inside, (leaders, zones).

    Every zone at such a concave crease leads its own area; the others follow the zones they meet at
    a convex crease, ring by ring, in proportion to the touched surface of those zones.
    """
    share = np.zeros((len(leaders), zones.count))
    share[np.arange(len(leaders)), leaders] = 1.0
    known = share.sum(axis=0) > 0.0
    meets = np.zeros((zones.count, zones.count), dtype=bool)
    meets[zones.convex[:, 0], zones.convex[:, 1]] = True
    meets |= meets.T
    while True:
        ring = np.flatnonzero(~known & (meets & known).any(axis=1))
        if not len(ring):
            return share
        for zone in ring:
            weight = np.where(meets[zone] & known, touched, 0.0)
            share[:, zone] = share @ weight / weight.sum()
        known[ring] = True


def _centroid(part: _Component, weight: Floats) -> Floats:
    """Mean of the triangle centres with the given weights (m,)."""
    centres = part.points[part.faces].mean(axis=1)
    return np.asarray(weight @ centres / weight.sum())


def _behind(
    piece: mf.Manifold, part: _Component, zones: _Zones, vectors: Floats, share: Floats, row: int
) -> Floats:
    """Corners (n, 3) of the part of the overlap that area `row` answers.

    An area that meets another one at a concave crease answers only what lies behind the planes of
    its zones there (mean normal, support of the touched part): what the other area holds beside it
    is none of its depth.
    """
    own = share[row] > 0.0
    shared = np.einsum("ai,aj->ij", share, share) > 0.0
    edges = (
        np.concatenate([zones.concave, zones.concave[:, ::-1]])
        if len(zones.concave)
        else zones.concave
    )
    for zone in {int(i) for i, j in edges if own[i] and not (own[j] and shared[i, j])}:
        n = vectors[zone] / np.linalg.norm(vectors[zone])
        top = float((part.points[part.faces[zones.of_face == zone]] @ n).max())
        piece = piece.trim_by_plane((-n).tolist(), -top - TRIM_MM)
    return np.asarray(piece.to_mesh64().vert_properties[:, :3], float)


def _component_areas(piece: mf.Manifold, part: _Component, normals: Floats) -> list[Area]:
    """The contact areas of one component."""
    zones = _find_zones(part, normals)
    size = np.linalg.norm(part.vectors, axis=1)
    ids = np.flatnonzero(part.is_static)
    touched = np.bincount(zones.of_face[ids], size[ids], zones.count).astype(float)
    vectors = np.zeros((zones.count, 3))
    np.add.at(vectors, zones.of_face[ids], part.vectors[ids])
    share = _memberships(zones, touched)
    tool_size = np.where(part.is_static, 0.0, size)
    areas = []
    for index, row in enumerate(share):
        total = row @ vectors
        length = float(np.linalg.norm(total))
        if length <= CANCEL_SHARE * float(row @ touched):
            continue
        n = total / length
        held = (
            part.points if len(share) == 1 else _behind(piece, part, zones, vectors, share, index)
        )
        own = part.points[np.unique(part.faces[ids[row[zones.of_face[ids]] > 0.0]])]
        # Zones shared with other areas count once in all: the area answers with the share it holds
        # of its zones' normals.
        held_share = length / float(np.linalg.norm((row > 0.0).astype(float) @ vectors))
        depth = held_share * float((own @ n).max() - (np.concatenate([held, own]) @ n).min())
        facing = np.where(part.is_static, 0.0, np.maximum(-part.vectors @ n, 0.0))
        weight = tool_size if len(share) == 1 else facing
        areas.append(Area(n, depth, _centroid(part, weight), float(row @ touched)))
    return areas


@dataclass(frozen=True)
class Contact:
    """Exact contact of one pose; imbalance: relative difference of both normal sums (0: exact)."""

    areas: list[Area]
    volume_mm3: float
    imbalance: float

    def force_mm(self) -> Floats:
        """F*/k: sum of depth times normal, (3,) mm."""
        return np.asarray(sum((a.depth_mm * a.normal for a in self.areas), np.zeros(3)))

    def torque_mm2(self, origin_mm: Floats) -> Floats:
        """Torque/k about `origin_mm`, (3,) mm^2."""
        arms = (np.cross(a.point_mm - origin_mm, a.depth_mm * a.normal) for a in self.areas)
        return np.asarray(sum(arms, np.zeros(3)))


def contact(static: Solid, tool: Solid, rotation: Floats, position_mm: Floats) -> Contact:
    """Contact of the tool at pose world_from_tool, rotation (3, 3) and position (3,) mm."""
    moved = tool.body.transform(np.column_stack([rotation, position_mm]))
    common = moved ^ static.body
    areas: list[Area] = []
    volume, imbalance = 0.0, 0.0
    for piece in common.decompose() if not common.is_empty() else []:
        size = piece.volume()
        if size < SLIVER_MM3:
            continue
        part = _component(piece, static.ident)
        if not part.is_static.any() or part.is_static.all():
            raise ValueError("one body lies wholly inside the other: no contact surface")
        areas += _component_areas(piece, part, static.normals)
        volume += size
        gap = np.linalg.norm(part.vectors.sum(axis=0)) / np.linalg.norm(part.vectors, axis=1).sum()
        imbalance = max(imbalance, float(gap))
    return Contact(areas, volume, imbalance)
