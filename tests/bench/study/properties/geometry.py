"""What booleans say about two solids in a pose: overlap or none, how thick, and whether a move leads out.

Nothing here knows a contact force. Lengths in mm throughout. Three of a pose's facts need a definition:
thickness   how far the obstacle's and the tool's part of a piece's surface lie apart at most; the largest piece's
jammed      no shift of some thicknesses leads out, along any direction tried
clearing s  the least s such that the tool, moved by s F/k, leaves no overlap
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.base.attitude import to_matrix
from crease.mesh.mend import to_manifold
from crease.mesh.mesh import Mesh
from scipy.spatial import ConvexHull

F64 = npt.NDArray[np.float64]

GONE_MM3 = 1e-10
GONE_SHARE = 1e-9
"""Overlap below this, or this share of what there was, is gone: 0.001 of the way in a corner, less elsewhere."""

POINTS_MAX = 150
"""Points of a piece that its thickness is taken from: those of curved pieces are thinned out."""

JAM_REACH = (1.02, 1.4, 1.9, 2.6, 3.6, 5.0, 7.0, 12.0)
"""Shifts that are tried, in thicknesses: close to each other, since what leaves one wall may meet the next."""
WAYS_MAX = 6
"""Normals of faces touched that are tried, and their pairs, to find a way out of a jam: the largest faces."""

S_MAX = 4.0
S_TRIES = (1.05, 1.3, 1.7, 2.2, 3.0, S_MAX)
"""Moves tried before the bisection. A force below a quarter of the way out, or that points elsewhere, is S_MAX."""


@dataclass(frozen=True)
class Overlap:
    """The overlap in a pose, world frame: volume, thickness, corners of its faces (m, 3, 3), which are the obstacle's.

    `piece` (m,): number of the piece that a face belongs to.
    """

    volume_mm3: float
    thickness_mm: float
    corners_mm: F64 = field(repr=False)
    from_static: npt.NDArray[np.bool_] = field(repr=False)
    piece: npt.NDArray[np.int64] = field(repr=False)


NOTHING = Overlap(
    0.0, 0.0, np.zeros((0, 3, 3)), np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64)
)


class Pair:
    """Obstacle and tool as solids, in mm."""

    def __init__(self, static: Mesh, tool: Mesh) -> None:
        """Errors: MeshError."""
        solids = [
            to_manifold(1e3 * m.vertices_m, m.triangles, 2e-5).as_original() for m in (static, tool)
        ]
        self.static, self.tool = (solid.simplify(2e-5) for solid in solids)
        self.static_vertices, self.tool_vertices = (_vertices(s) for s in (self.static, self.tool))
        self.radius_mm = float(np.linalg.norm(self.tool_vertices, axis=1).max())
        hulls = [v[ConvexHull(v).vertices] for v in (self.static_vertices, self.tool_vertices)]
        self._static_hull, self._tool_hull = hulls
        self._borders: dict[float, list[F64]] = {}

    def moved(self, pose: F64) -> Any:
        """The tool in a pose (7,): mm and quaternion."""
        return self.tool.transform(np.hstack([to_matrix(pose[3:]), pose[:3, None]]))

    def volume(self, pose: F64) -> float:
        """Volume of the overlap, mm^3."""
        return float((self.static ^ self.moved(pose)).volume())

    def overlap(self, pose: F64) -> Overlap:
        """All about the overlap in a pose."""
        both = self.static ^ self.moved(pose)
        volume = float(both.volume())
        if volume <= GONE_MM3:
            return NOTHING
        pieces = [p for p in both.decompose() if p.volume() > GONE_MM3]
        faces = [self._faces(p) for p in pieces]
        if not faces:
            return NOTHING
        corners = np.concatenate([c for c, _ in faces])
        index = np.repeat(np.arange(len(faces)), [len(c) for c, _ in faces])
        thick = max(_thickness(*f) for f in faces)
        return Overlap(volume, thick, corners, np.concatenate([s for _, s in faces]), index)

    def _faces(self, piece: Any) -> tuple[F64, npt.NDArray[np.bool_]]:
        mesh = piece.to_mesh64()
        ids = np.repeat(mesh.run_original_id, np.diff(mesh.run_index) // 3)
        points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
        return points[np.asarray(mesh.tri_verts)], np.asarray(ids == self.static.original_id())

    def clearing(self, pose: F64, volume_mm3: float, way_mm: F64) -> float:
        """The clearing factor s of a force over stiffness `way_mm` (3,), at most S_MAX; S_MAX without a force."""
        if float(np.linalg.norm(way_mm)) < 1e-6:
            return S_MAX
        tool, gone = self.moved(pose), max(GONE_MM3, GONE_SHARE * volume_mm3)

        def is_clear(s: float) -> bool:
            return float((self.static ^ tool.translate((s * way_mm).tolist())).volume()) <= gone

        low = 0.0
        for high in S_TRIES:
            if is_clear(high):
                break
            low = high
        else:
            return S_MAX
        while high - low > 0.006:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if is_clear(middle) else (middle, high)
        return high

    def is_jammed(self, pose: F64, overlap: Overlap) -> bool:
        """Whether no shift of JAM_REACH thicknesses leads out: along normals touched, their pairs, and axes."""
        tool, gone = self.moved(pose), max(GONE_MM3, GONE_SHARE * overlap.volume_mm3)
        for direction in _ways_out(overlap):
            for reach in JAM_REACH:
                shift = (reach * overlap.thickness_mm * direction).tolist()
                if float((self.static ^ tool.translate(shift)).volume()) <= gone:
                    return False
        return True

    def exit_mm(self, pose: F64, direction: F64) -> float:
        """How far along a unit direction the tool has to go until both hulls are apart; 0 when they are."""
        turned = self._tool_hull @ to_matrix(pose[3:]).T
        sums = (self._static_hull[:, None, :] - turned[None, :, :]).reshape(-1, 3)
        planes = ConvexHull(sums).equations
        below = -(planes[:, :3] @ pose[:3] + planes[:, 3])
        if below.min() <= 0.0:
            return 0.0
        ahead = planes[:, :3] @ direction
        return float((below[ahead > 1e-9] / ahead[ahead > 1e-9]).min())

    def border_mm(self, z_mm: float, point: F64) -> float:
        """Largest distance of points (n, 3), in the plane, from the border of the obstacle's cut just below z."""
        if z_mm not in self._borders:
            self._borders[z_mm] = [
                np.asarray(p) for p in self.static.slice(z_mm - 1e-3).to_polygons()
            ]
        far = np.full(len(point), np.inf)
        for ring in self._borders[z_mm]:
            a, b = ring, np.roll(ring, -1, axis=0)
            t = np.einsum("nkd,kd->nk", point[:, None, :2] - a, b - a) / ((b - a) ** 2).sum(axis=1)
            foot = a + np.clip(t, 0.0, 1.0)[..., None] * (b - a)
            far = np.minimum(far, np.linalg.norm(point[:, None, :2] - foot, axis=2).min(axis=1))
        return float(far.max(initial=0.0))


def _vertices(solid: Any) -> F64:
    return np.asarray(solid.to_mesh64().vert_properties, dtype=np.float64)[:, :3]


def face_normals(corners_mm: F64) -> tuple[F64, F64]:
    """Unit normals (m, 3) and areas (m,) of triangles (m, 3, 3)."""
    cross = np.cross(corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], 0.5 * length


def _thickness(corners_mm: F64, from_static: npt.NDArray[np.bool_]) -> float:
    """See the module: from points of either part, vertices, middles of edges and of faces, to the other part."""
    parts = corners_mm[from_static], corners_mm[~from_static]
    if not (len(parts[0]) and len(parts[1])):
        return 0.0
    far = 0.0
    for mine, other in (parts, parts[::-1]):
        middles = 0.5 * (mine + np.roll(mine, 1, axis=1)).reshape(-1, 3)
        points = np.concatenate([mine.reshape(-1, 3), middles, mine.mean(axis=1)])
        points = np.unique(np.round(points, 6), axis=0)
        points = points[:: max(1, len(points) // POINTS_MAX)]
        far = max(far, float(distances(points, other).max()))
    return far


def distances(points: F64, corners: F64) -> F64:
    """Distance of points (n, 3) from the nearest of triangles (m, 3, 3), (n,).

    The nearest point of a triangle is its foot when that is inside, else on the nearest edge.
    """
    squares = np.full(len(points), np.inf)
    for k in range(3):
        a, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        length = np.maximum((along**2).sum(axis=1), 1e-30)
        t = np.clip((points @ along.T - (a * along).sum(axis=1)) / length, 0.0, 1.0)
        gap = points[:, None] - a - t[..., None] * along
        squares = np.minimum(squares, (gap**2).sum(axis=2).min(axis=1))
    normals, area = face_normals(corners)
    height = points @ normals.T - (corners[:, 0] * normals).sum(axis=1)
    inside = np.broadcast_to(area > 1e-12, height.shape).copy()
    for k in range(3):
        a, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        inward = np.cross(normals, along)
        inside &= points @ inward.T - (a * inward).sum(axis=1) >= 0.0
    return np.asarray(np.sqrt(np.minimum(squares, np.where(inside, height**2, np.inf).min(axis=1))))


def _ways_out(overlap: Overlap) -> F64:
    """Unit directions (m, 3)."""
    normals, area = face_normals(overlap.corners_mm[overlap.from_static])
    rounded, index = np.unique(np.round(normals, 1), axis=0, return_inverse=True)
    weight = np.bincount(index.reshape(-1), area)
    touched = rounded[np.argsort(-weight)[:WAYS_MAX]]
    pairs = (touched[:, None] + touched[None]).reshape(-1, 3)
    ways = np.concatenate([touched, pairs, np.eye(3), -np.eye(3)])
    length = np.linalg.norm(ways, axis=1)
    ways = ways[length > 0.1] / length[length > 0.1, None]
    _, first = np.unique(np.round(ways, 3), axis=0, return_index=True)
    return np.asarray(ways[np.sort(first)])


def width_mm(points: F64, normal: F64) -> float:
    """The least width of points (n, 3) seen along a unit normal, over directions 5 degrees apart; 0 of none."""
    if not len(points):
        return 0.0
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    angle = np.radians(np.arange(0.0, 180.0, 5.0))
    across = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second)
    return float(np.ptp(points @ across.T, axis=0).min())
