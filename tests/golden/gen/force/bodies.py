"""Closed triangle meshes as the prototype sees them: smooth patches, creases, exact distance, surface samples.

Units mm; normals outward. Nothing here is shared with the firmware or the host package.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import igl
import manifold3d as mf
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CREASE_DEG = 30.0
FLAT_DEG = 0.05
# A closest point this near an edge or corner of its triangle (mm) lies on it.
ON_EDGE_MM = 1e-7


def _components(count: int, a: Ints, b: Ints) -> Ints:
    links = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def _unit(v: Floats) -> Floats:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300))


@dataclass
class Body:
    """A solid: vertices (n, 3), faces (m, 3), smooth patch per face, and which patches are planes."""

    vertices: Floats
    faces: Ints
    normals: Floats = field(init=False)
    areas: Floats = field(init=False)
    patch: Ints = field(init=False)
    patch_normal: Floats = field(init=False)
    patch_point: Floats = field(init=False)
    flat: NDArray[np.bool_] = field(init=False)
    convexity: Floats = field(init=False)

    def __post_init__(self) -> None:
        v, f = self.vertices, self.faces
        cross = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
        self.areas = 0.5 * np.linalg.norm(cross, axis=1)
        self.normals = _unit(cross)
        self._find_edges()
        self._find_patches()
        self._find_convexity()
        self._find_features()
        self.tree = igl.AABB()
        self.tree.init(v, f)

    def _find_edges(self) -> None:
        """Neighbour across edge k of a face (its corners k, k + 1), and the sign of its turn: > 0 convex."""
        f = self.faces
        directed = {(int(f[i, k]), int(f[i, (k + 1) % 3])): (i, k) for i in range(len(f)) for k in range(3)}
        self.beside = np.array(
            [[directed[int(f[i, (k + 1) % 3]), int(f[i, k])][0] for k in range(3)] for i in range(len(f))]
        )
        along = self.vertices[np.roll(f, -1, axis=1)] - self.vertices[f]
        turn = np.cross(self.normals[:, None], self.normals[self.beside])
        self.turn = np.einsum("ijk,ijk->ij", turn, _unit(along))
        self.angle_cos = np.einsum("ik,ijk->ij", self.normals, self.normals[self.beside])

    def _find_patches(self) -> None:
        i = np.repeat(np.arange(len(self.faces)), 3)
        j = self.beside.ravel()
        smooth = self.angle_cos.ravel() > np.cos(np.radians(CREASE_DEG))
        self.patch = _components(len(self.faces), i[smooth], j[smooth])
        count = int(self.patch.max()) + 1
        total = np.zeros((count, 3))
        np.add.at(total, self.patch, self.normals * self.areas[:, None])
        self.patch_normal = _unit(total)
        off = np.einsum("ij,ij->i", self.normals, self.patch_normal[self.patch])
        self.flat = np.ones(count, dtype=bool)
        np.logical_and.at(self.flat, self.patch, off > np.cos(np.radians(FLAT_DEG)))
        first = np.zeros(count, np.int64)
        first[self.patch[::-1]] = np.arange(len(self.faces))[::-1]
        self.patch_point = self.vertices[self.faces[first, 0]]

    def _find_convexity(self) -> None:
        """1 where two flat patches are the same or meet or face convexly, 0 where concavely; nan where one is curved."""
        count = len(self.patch_normal)
        height = np.full((count, count), -np.inf)
        for b in range(count):
            over = (self.vertices[self.faces] - self.patch_point[b]) @ self.patch_normal[b]
            np.maximum.at(height[b], self.patch, over.max(axis=1))
        table = ((height < 1e-4) & (height.T < 1e-4)).astype(float)
        crease = self.angle_cos < np.cos(np.radians(CREASE_DEG))
        pairs = np.stack([np.repeat(self.patch, 3), self.patch[self.beside].ravel()], axis=1)
        convex = crease.ravel() & (self.turn.ravel() > 0.0)
        concave = crease.ravel() & (self.turn.ravel() < 0.0)
        table[pairs[convex, 0], pairs[convex, 1]] = 1.0
        table[pairs[concave, 0], pairs[concave, 1]] = 0.0
        both = self.flat[:, None] & self.flat[None, :]
        self.convexity = np.where(both, table, np.nan)
        np.fill_diagonal(self.convexity, np.where(self.flat, 1.0, np.nan))

    def _find_features(self) -> None:
        """Pseudonormals of edges and corners; patches that meet at a corner."""
        f = self.faces
        self.edge_normal = _unit(self.normals[:, None] + self.normals[self.beside])
        a = self.vertices[np.roll(f, -1, axis=1)] - self.vertices[f]
        b = self.vertices[np.roll(f, -2, axis=1)] - self.vertices[f]
        corner = np.arccos(np.clip(np.einsum("ijk,ijk->ij", _unit(a), _unit(b)), -1.0, 1.0))
        total = np.zeros_like(self.vertices)
        np.add.at(total, f.ravel(), (corner[..., None] * self.normals[:, None]).reshape(-1, 3))
        self.corner_normal = _unit(total)
        self.corner_patches: list[dict[int, Floats]] = [{} for _ in self.vertices]
        for i in range(len(f)):
            for k in range(3):
                at = self.corner_patches[int(f[i, k])]
                p = int(self.patch[i])
                at[p] = at.get(p, np.zeros(3)) + self.normals[i] * corner[i, k]

    def closest(self, points: Floats) -> tuple[Floats, Ints, Floats, Ints]:
        """Signed distance (> 0 outside), face, closest point, feature: 0 face, 1..3 edge, 4..6 corner."""
        square, face, foot = self.tree.squared_distance(self.vertices, self.faces, np.ascontiguousarray(points))
        face = np.asarray(face, np.int64).ravel()
        foot = np.asarray(foot).reshape(-1, 3)
        corners = self.vertices[self.faces[face]]
        along = np.roll(corners, -1, axis=1) - corners
        inward = np.cross(self.normals[face][:, None], along)
        inward = _unit(inward)
        gap = np.einsum("ijk,ijk->ij", foot[:, None] - corners, inward)
        on = gap < ON_EDGE_MM
        feature = np.where(on.any(axis=1), 1 + on.argmax(axis=1), 0)
        for k in range(3):  # corner k lies on edges k and k - 1
            feature = np.where(on[:, k] & on[:, k - 1], 4 + k, feature)
        away = self.normals[face].copy()
        edge = (feature >= 1) & (feature <= 3)
        away[edge] = self.edge_normal[face[edge], feature[edge] - 1]
        tip = feature >= 4
        away[tip] = self.corner_normal[self.faces[face[tip], feature[tip] - 4]]
        reach = points - foot
        sign = np.where(np.einsum("ij,ij->i", reach, away) < 0.0, -1.0, 1.0)
        return sign * np.sqrt(np.maximum(np.asarray(square).ravel(), 0.0)), face, foot, feature


def from_manifold(body: mf.Manifold) -> Body:
    """A body whose coplanar triangles are as few as the boolean library leaves."""
    mesh = body.simplify(2e-5).to_mesh64()
    return Body(
        np.array(mesh.vert_properties[:, :3], float, order="C"), np.array(mesh.tri_verts, np.int64, order="C")
    )


@dataclass
class Samples:
    """Surface samples: points (n, 3), area vectors (n, 3) (zero on edges and corners), patch, outward normal."""

    points: Floats
    areas: Floats
    patch: Ints
    normals: Floats


def sample(body: Body, spacing_mm: float) -> Samples:
    """Every triangle cut into equal ones no larger than the spacing; their centres carry area, their corners none."""
    points, areas, patch, normals = [], [], [], []
    for i, face in enumerate(body.faces):
        tri = body.vertices[face]
        n = max(1, int(np.ceil(np.linalg.norm(tri - np.roll(tri, 1, axis=0), axis=1).max() / spacing_mm)))
        a, b = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        grid = (a + b <= n).ravel()
        up = (a + b <= n - 1).ravel()
        down = (a + b <= n - 2).ravel()
        a, b = a.ravel(), b.ravel()
        uv = [np.stack([a[up] + 1 / 3, b[up] + 1 / 3], 1), np.stack([a[down] + 2 / 3, b[down] + 2 / 3], 1)]
        uv.append(np.stack([a[grid], b[grid]], 1).astype(float))
        q = np.vstack(uv) / n
        p = tri[0] + q[:, :1] * (tri[1] - tri[0]) + q[:, 1:] * (tri[2] - tri[0])
        w = np.zeros(len(p))
        w[: n * n] = body.areas[i] / (n * n)
        points.append(p)
        areas.append(w[:, None] * body.normals[i])
        patch.append(np.full(len(p), body.patch[i]))
        normals.append(np.tile(body.normals[i], (len(p), 1)))
    return Samples(np.vstack(points), np.vstack(areas), np.concatenate(patch), np.vstack(normals))
