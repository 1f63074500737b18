"""What a mesh file holds, for `crease check`: closed or not, crossings, walls, edges, what `bake` would do with it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import MeshError
from crease.mesh import topology
from crease.mesh.mend import CROSSING
from crease.mesh.mesh import Mesh, load_mesh, read_arrays

F64 = npt.NDArray[np.float64]

WALL_POINTS = 4000
"""Points of the surface at which walls are measured."""
WALL_STEPS = 24
"""Halvings of the radius of the ball that fits between a point and the wall behind it."""
OPPOSITE = -0.7
"""Cosine between the normals of two sides of a wall, at most: two faces of an edge are no wall."""
SEED = 4


@dataclass(frozen=True)
class Findings:
    """Facts of one mesh. Lengths in m; places (n, 3) in m; reason: why bake would refuse it, or empty."""

    source: str
    unit_m: float
    vertices_m: F64
    triangles: npt.NDArray[np.int32]
    open_edges_m: F64
    turned_edges_m: F64
    """Edges (n, 2, 3) whose two triangles run the same way: one of them is turned."""
    branched_edges: int
    crossings_m: F64
    mesh: Mesh | None
    reason: str
    shells: int = 0
    volume_m3: float = 0.0
    area_m2: float = 0.0
    wall_m: float = math.inf
    wall_at_m: F64 = field(default_factory=lambda: np.zeros((0, 3)))
    crease_angle_deg: float = 30.0
    sharpest_rad: float | None = None
    """None: no edge is over the crease angle."""
    sharpest_at_m: F64 = field(default_factory=lambda: np.zeros((0, 3)))
    creases: tuple[int, int] = (0, 0)
    creases_m: F64 = field(default_factory=lambda: np.zeros((0, 2, 3)))
    """Both ends of each crease (n, 2, 3)."""
    noise: tuple[str, ...] = ()
    far: tuple[str, ...] = ()

    def report(self) -> dict[str, Any]:
        """For a program: lengths in m, places in the unit of the file."""
        return {
            "file": self.source,
            "triangles": len(self.triangles),
            "size_m": np.ptp(self.vertices_m, axis=0).tolist(),
            "closed": len(self.open_edges_m) == 0 and self.branched_edges == 0,
            "open_edges": len(self.open_edges_m),
            "open_at": self._place(self.open_edges_m.mean(axis=1)),
            "branched_edges": self.branched_edges,
            "turned_edges": len(self.turned_edges_m),
            "turned_at": self._place(self.turned_edges_m.mean(axis=1)),
            "crossings": len(self.crossings_m),
            "crossing_at": self._place(self.crossings_m),
            "shells": self.shells,
            "volume_m3": self.volume_m3,
            "area_m2": self.area_m2,
            "thinnest_wall_m": self.wall_m if math.isfinite(self.wall_m) else None,
            "thinnest_wall_at": self._place(self.wall_at_m),
            "sharpest_edge_deg": None
            if self.sharpest_rad is None
            else math.degrees(self.sharpest_rad),
            "sharpest_edge_at": self._place(self.sharpest_at_m),
            "convex_creases": self.creases[0],
            "concave_creases": self.creases[1],
            "accepted": self.mesh is not None,
            "bake": [*self.mesh.warnings, *self.far, *self.noise] if self.mesh else [self.reason],
        }

    def _place(self, points_m: F64) -> list[float] | None:
        return (points_m[0] / self.unit_m).tolist() if len(points_m) else None


def examine(
    path: Path,
    unit_m: float,
    crease_angle_deg: float = 30.0,
    sheet_m: float | None = None,
    voxel_m: float | None = None,
) -> Findings:
    """Findings of a mesh file.   voxel_m: None: the least that bake takes by itself.

    Errors: MeshError when it cannot be read.
    """
    from crease.bake.bake import default_voxel_m, far_warning

    vertices, corners = read_arrays(path, unit_m)
    vertices = vertices * unit_m
    first, kind = topology.weld(vertices)
    vertices, triangles = topology.compact(vertices[first], kind[corners].astype(np.int32))
    start, end = topology.directed_edges(triangles)
    loose, turned = _loose_edges(triangles, len(vertices))
    _, branched = topology.edge_use(triangles, len(vertices))
    diagonal_m = math.hypot(*np.ptp(vertices, axis=0))
    pairs = topology.crossing_pairs(vertices, triangles, CROSSING * diagonal_m)
    seen = {
        "source": str(path),
        "unit_m": unit_m,
        "vertices_m": vertices,
        "triangles": triangles,
        "open_edges_m": np.stack([vertices[start[loose]], vertices[end[loose]]], axis=1),
        "turned_edges_m": np.stack([vertices[start[turned]], vertices[end[turned]]], axis=1),
        "branched_edges": branched,
        "crease_angle_deg": crease_angle_deg,
        "crossings_m": vertices[triangles[pairs]].mean(axis=(1, 2)),
    }
    try:
        mesh = load_mesh(path, unit_m, sheet_m=sheet_m)
    except MeshError as error:
        return Findings(**seen, mesh=None, reason=str(error))
    far = tuple(far_warning(mesh, voxel_m or default_voxel_m(mesh, 0.0)))
    return Findings(**seen, mesh=mesh, reason="", far=far, **_of_solid(mesh, crease_angle_deg))


def _loose_edges(
    triangles: topology.Triangles, vertex_count: int
) -> tuple[topology.Indices, topology.Indices]:
    """Edges (of 3 m) that are open, and those that two triangles share and run along the same way, each once."""
    loose = topology.unbalanced_edges(triangles, vertex_count)
    one, two = topology.paired_edges(triangles, vertex_count)
    turned = np.isin(one, loose)
    return np.setdiff1d(loose, np.r_[one[turned], two[turned]]), one[turned]


def _of_solid(mesh: Mesh, crease_angle_deg: float) -> dict[str, Any]:
    from crease.bake.bake import noise_warning
    from crease.bake.surface import make_surface

    surface = make_surface(mesh, crease_angle_deg)
    shells, _ = topology.shells(mesh.vertices_m, mesh.triangles)
    wall_m, wall_at_m = thinnest_wall(surface)
    creases = surface.creases
    sharpest = int(np.argmax(creases.angle_rad)) if len(creases.convex) else -1
    return {
        "shells": shells,
        "volume_m3": float(topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum()),
        "area_m2": float(topology.areas_m2(mesh.vertices_m, mesh.triangles).sum()),
        "wall_m": wall_m,
        "wall_at_m": wall_at_m,
        "sharpest_rad": float(creases.angle_rad[sharpest]) if sharpest >= 0 else None,
        "sharpest_at_m": creases.ends_m[sharpest].mean(axis=0)[None]
        if sharpest >= 0
        else np.zeros((0, 3)),
        "creases": (surface.counts["convex_edges"], surface.counts["concave_edges"]),
        "creases_m": creases.ends_m,
        "noise": tuple(noise_warning(surface, crease_angle_deg)),
    }


def thinnest_wall(surface: Any) -> tuple[float, F64]:
    """Least thickness of a wall, in m, and the middle of the wall there (1, 3); infinite and (0, 3) without walls.

    At points of the surface: diameter of the largest ball inside that touches there, when it touches a face that looks
    the other way too.
    """
    mesh = surface.mesh
    corners = mesh.vertices_m[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-300)[:, None]
    rng = np.random.default_rng(SEED)
    which = rng.choice(len(area), WALL_POINTS, p=area / area.sum())
    uv = np.sort(rng.random((WALL_POINTS, 2)), axis=1)
    weight = np.column_stack([uv[:, 0], uv[:, 1] - uv[:, 0], 1.0 - uv[:, 1]])
    at = np.einsum("nk,nkx->nx", weight, corners[which])
    inward = -normal[which]
    low = np.zeros(WALL_POINTS)
    high = np.full(WALL_POINTS, float(np.linalg.norm(np.ptp(mesh.vertices_m, axis=0))))
    for _ in range(WALL_STEPS):
        radius = 0.5 * (low + high)
        phi, _ = surface.signed_distance(at + radius[:, None] * inward)
        fits = -phi >= radius * (1.0 - 1e-6)
        low, high = np.where(fits, radius, low), np.where(fits, high, radius)
    centre = at + high[:, None] * inward
    _, nearest = surface.signed_distance(centre)
    wall = np.einsum("nx,nx->n", normal[nearest], normal[which]) < OPPOSITE
    if not wall.any():
        return math.inf, np.zeros((0, 3))
    thickness = np.where(wall, 2.0 * low, np.inf)
    least = int(np.argmin(thickness))
    return float(thickness[least]), centre[least][None]
