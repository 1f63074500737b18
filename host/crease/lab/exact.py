"""The extent of the overlap of two solids in one pose, exact, from a boolean of their meshes.

What the contact-zone method converges to at convex creases (firmware/rivals/EXTENT.md "Zones and area normal"):
F* = k d* n*, n* against the gradient of the overlap volume, d* the extent of the overlap along it. Separate pieces of
overlap answer on their own, and add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.attitude import to_matrix
from crease.mesh.mend import to_manifold
from crease.mesh.mesh import Mesh

F64 = npt.NDArray[np.float64]

SMALL_M3 = 1e-15
"""Pieces of overlap below this volume are rounding."""


@dataclass(frozen=True)
class Solids:
    """The two bodies as manifold3d has them: coplanar triangles merged, so that tessellation does not enter."""

    static: Any
    tool: Any


@dataclass(frozen=True)
class Piece:
    """One connected piece of overlap, world frame: corners (m, 3, 3) of its faces; which are the static object's."""

    corners_m: F64
    from_static: npt.NDArray[np.bool_]


def make_solids(static: Mesh, tool: Mesh) -> Solids:
    """Errors: MeshError."""
    both = [to_manifold(m.vertices_m, m.triangles, 2e-8).as_original() for m in (static, tool)]
    return Solids(*(solid.simplify(2e-8) for solid in both))


def world_from_tool(pose: F64) -> F64:
    """World from tool, (3, 4), of x y z and a unit quaternion w x y z."""
    return np.hstack([to_matrix(pose[3:]), pose[:3, None]])


def _pieces(solids: Solids, pose: F64) -> list[Any]:
    """The connected pieces of overlap of a pose (7,), as solids."""
    moved = solids.tool.transform(world_from_tool(np.asarray(pose, dtype=np.float64)))
    both = solids.static ^ moved
    pieces = both.decompose() if both.num_tri() else []
    return [piece for piece in pieces if piece.volume() > SMALL_M3]


def _faces(solids: Solids, piece: Any) -> Piece:
    mesh = piece.to_mesh64()
    ids = np.repeat(mesh.run_original_id, np.diff(mesh.run_index) // 3)
    points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return Piece(points[np.asarray(mesh.tri_verts)], ids == solids.static.original_id())


def overlap(solids: Solids, pose: F64) -> list[Piece]:
    """The pieces of overlap of a pose (7,)."""
    return [_faces(solids, piece) for piece in _pieces(solids, pose)]


def _answer(corners_m: F64, from_static: npt.NDArray[np.bool_]) -> tuple[F64, float]:
    """Force over stiffness and depth of what answers as one; zero where its faces balance."""
    a, b, c = corners_m.transpose(1, 0, 2)
    area = 0.5 * np.cross(b - a, c - a)
    pull = area[from_static].sum(axis=0)
    length = float(np.linalg.norm(pull))
    if length <= 1e-6 * float(np.linalg.norm(area, axis=1).sum()):
        return np.zeros(3), 0.0
    n = pull / length
    heights = corners_m @ n
    depth = float(heights[from_static].max() - heights.min())
    return depth * n, depth


def exact_contact(solids: Solids, pose: F64) -> tuple[F64, float]:
    """Force over stiffness (3,) in m and the depth of the deepest piece in m.   Cost: about 1 ms for simple solids."""
    answers = [_answer(p.corners_m, p.from_static) for p in overlap(solids, pose)]
    return sum((f for f, _ in answers), np.zeros(3)), max((d for _, d in answers), default=0.0)


def exact_joined(solids: Solids, pose: F64, gap_m: float) -> F64:
    """Force over stiffness (3,) in m where pieces of overlap nearer to each other than gap_m count as one.

    The exact force jumps by the difference to `exact_contact` when such pieces meet: two contacts become one.
    """
    pieces = _pieces(solids, pose)
    group = list(range(len(pieces)))
    for i, one in enumerate(pieces):
        for j, other in enumerate(pieces[:i]):
            if group[i] != group[j] and one.min_gap(other, gap_m) < gap_m:
                group = [group[j] if g == group[i] else g for g in group]
    force = np.zeros(3)
    for g in set(group):
        faces = [_faces(solids, p) for p, mine in zip(pieces, group, strict=True) if mine == g]
        corners_m = np.concatenate([f.corners_m for f in faces])
        force += _answer(corners_m, np.concatenate([f.from_static for f in faces]))[0]
    return force


def exact_path(solids: Solids, poses: F64) -> tuple[F64, F64]:
    """exact_contact of every pose (n, 7): forces over stiffness (n, 3) and depths (n,), in m."""
    found = [exact_contact(solids, pose) for pose in poses]
    return np.array([f for f, _ in found]), np.array([d for _, d in found])


def convex_planes(mesh: Mesh) -> F64:
    """Planes (m, 4) of a convex mesh: normal n and offset, n x <= offset inside."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(mesh.vertices_m).equations
    _, first = np.unique(np.round(found, 7), axis=0, return_index=True)
    planes: F64 = np.column_stack([found[first, :3], -found[first, 3]])
    return planes


def exact_exit_m(static: F64, tool: F64, pose: F64, along: F64) -> float:
    """How far a convex tool goes along a unit vector to leave a convex static object, m; 0 if they are apart.

    static, tool: planes of `convex_planes`.   Method: the longest t for which some point x of the static object has
    x - t along in the tool, a linear programme.   Cost: about 2 ms.
    """
    from scipy.optimize import linprog

    placed = world_from_tool(pose)
    normal = tool[:, :3] @ placed[:, :3].T
    offset = tool[:, 3] + normal @ placed[:, 3]
    rows = np.block(
        [[static[:, :3], np.zeros((len(static), 1))], [normal, -(normal @ along)[:, None]]]
    )
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        rows,
        np.r_[static[:, 3], offset],
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    return -float(found.fun) if found.success else 0.0
