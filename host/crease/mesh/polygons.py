"""Faces of more than three corners: formats that have them, and what their readers make of them.

Readers cut a polygon into a fan round its first corner. Of one that is not convex some triangles lie outside of it,
folded back on others in its plane: `unfold` cuts such a face anew.
"""

from __future__ import annotations

import re
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.mesh import closing, topology
from crease.mesh.topology import Vertices

WITH_POLYGONS = (".obj", ".off", ".ply")
"""Suffixes of formats whose faces may have any number of corners."""
PLANE = 1e-5
"""Share of the diagonal within which triangles lie in one plane: files of five digits keep it."""
COUNTS = 3
"""Numbers of the line of counts in an OFF file: vertices, faces, edges."""


def parse_off(text: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Vertices and fans of the faces of an OFF file, whatever colours and normals it has.   Errors: ValueError."""
    lines = (line.split("#", 1)[0].split() for line in text.splitlines())
    rows = iter([row for row in lines if row])
    head = next(rows, [])
    found = re.fullmatch(r"(ST)?C?N?OFF", head[0].upper()) if head else None
    if found is None:
        raise ValueError("the first line does not say OFF")
    counts = head[1:] or next(rows, [])
    if len(counts) < COUNTS - 1:
        raise ValueError("the line of counts is missing")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    points = [row[:3] for row in islice(rows, vertex_count)]
    if len(points) < vertex_count:
        raise ValueError(f"{len(points):,} of {vertex_count:,} vertices are there")
    faces = [[int(v) for v in row[1 : 1 + int(row[0])]] for row in islice(rows, face_count)]
    if len(faces) < face_count:
        raise ValueError(f"{len(faces):,} of {face_count:,} faces are there")
    fans = [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]
    vertices = np.array(points, np.float64).reshape(-1, 3)
    return vertices, np.array(fans, np.int64).reshape(-1, 3)


def unfold(vertices: Vertices, triangles: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The triangles, with plane faces cut anew of which some lie folded back on others. Same vertices, same rims.

    Shapes: vertices (n, 3) in any unit, triangles (m, 3).
    """
    points = np.asarray(vertices, np.float64)
    if len(triangles) == 0 or triangles.min() < 0 or triangles.max() >= len(points):
        return triangles
    first, second = (edge // 3 for edge in topology.paired_edges(triangles, len(points)))
    with np.errstate(all="ignore"):
        a, b, c = (points[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        reach = PLANE * float(np.linalg.norm(np.ptp(points, axis=0)))
        plane = _in_plane(points, triangles, normal, first, second, reach)
        plane &= _in_plane(points, triangles, normal, second, first, reach)
        along = np.einsum("ij,ij->i", normal[first], normal[second])
    # A fold may hide behind a triangle without area.
    flat = ~np.isnan(normal[:, 0])
    seeds = np.where(flat[first], first, second)[plane & ~(along >= 0.0)]
    if len(seeds) == 0:
        return triangles
    beside: dict[int, list[int]] = {}
    for i, j in zip(first[plane].tolist(), second[plane].tolist(), strict=True):
        beside.setdefault(i, []).append(j)
        beside.setdefault(j, []).append(i)
    kept, made, seen = np.ones(len(triangles), bool), [], set[int]()
    for seed in seeds[flat[seeds]].tolist():
        if seed in seen:
            continue
        face = _face_of(seed, points, triangles, normal, beside, reach)
        seen.update(face)
        if not (normal[face] @ normal[seed] < 0.0).any():
            continue
        again = _cut_anew(points, triangles[face])
        if again is not None:
            kept[face] = False
            made.append(again)
    return np.concatenate([triangles[kept], *made]) if made else triangles


def _in_plane(
    points: npt.NDArray[np.float64],
    triangles: npt.NDArray[Any],
    normal: npt.NDArray[np.float64],
    of: npt.NDArray[np.int64],
    other: npt.NDArray[np.int64],
    reach: float,
) -> npt.NDArray[np.bool_]:
    """Whether the corners of others lie in the planes of some triangles: of one without area in all."""
    away = points[triangles[other]] - points[triangles[of, 0]][:, None, :]
    return np.asarray(~(np.abs(np.einsum("nkj,nj->nk", away, normal[of])) > reach).any(axis=1))


def _face_of(
    seed: int,
    points: npt.NDArray[np.float64],
    triangles: npt.NDArray[Any],
    normal: npt.NDArray[np.float64],
    beside: dict[int, list[int]],
    reach: float,
) -> list[int]:
    """The triangles in the plane of one that hang together with it."""
    face, origin = {seed}, points[triangles[seed, 0]]
    left = [seed]
    while left:
        for t in beside.get(left.pop(), []):
            height = (points[triangles[t]] - origin) @ normal[seed]
            if t not in face and np.abs(height).max() <= reach:
                face.add(t)
                left.append(t)
    return sorted(face)


def _cut_anew(
    points: npt.NDArray[np.float64], face: npt.NDArray[Any]
) -> npt.NDArray[np.int64] | None:
    """Triangles of the same rims that do not overlap; None where there are none such."""
    from manifold3d import triangulate

    rims = [loop[::-1] for loop in closing.rims(face, len(points))]
    corners = points[face]
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(
        axis=0
    )
    size = float(np.linalg.norm(vector))
    if not rims or size <= 0.0:
        return None
    normal = vector / size
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(normal, across)])
    centre = corners.reshape(-1, 3).mean(axis=0)
    number = np.concatenate([np.array(loop, np.int64) for loop in rims])
    flat = [np.ascontiguousarray((points[loop] - centre) @ axes.T) for loop in rims]
    made = number[np.asarray(triangulate(flat)).reshape(-1, 3)]
    a, b, c = (points[made[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a) @ normal
    whole = len(made) > 0 and area.min() >= -1e-9 * size and abs(area.sum() - size) <= 1e-6 * size
    return made if whole else None
