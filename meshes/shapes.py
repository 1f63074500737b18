"""Closed triangle meshes of the test scenes, in mm; every function is deterministic.

A mesh is a pair (vertices, faces): float64 (n, 3) in mm and int64 (m, 3), outward faces
counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import manifold3d as mf
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import Delaunay
from shapely.geometry import Polygon

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mesh = tuple[Floats, Ints]

INCH_MM = 25.4
# Tessellation vertices lie on this grid, so that float32 keeps them exactly and planar faces stay
# planar.
GRID_MM = 1.0 / 1024.0

STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _warp(t: Floats, strength: float) -> Floats:
    """Monotone map of [0, 1] onto itself; strength |s| < 1: density uneven by (1+s)/(1-s)."""
    return t + strength * np.sin(2.0 * np.pi * t) / (2.0 * np.pi)


def _spread(count: int, rng: np.random.Generator, margin: tuple[float, float]) -> Floats:
    """`count` irregular but evenly spread points of the unit square, (count, 2).

    Source: R2 low-discrepancy sequence (plastic number), warped so that the density varies.
    """
    plastic = 1.3247179572447460
    step = np.array([1.0 / plastic, 1.0 / plastic**2])
    uv = (rng.random(2) + np.arange(1, count + 1)[:, None] * step) % 1.0
    strength = rng.uniform(0.3, 0.6, 2) * rng.choice([-1.0, 1.0], 2)
    uv = np.column_stack([_warp(uv[:, k], strength[k]) for k in range(2)])
    inset = np.asarray(margin)
    return np.asarray(inset + uv * (1.0 - 2.0 * inset))


def _edge_points(a: Floats, b: Floats, count: int, rng: np.random.Generator) -> Floats:
    """`count` unevenly spaced points strictly between a and b, (count, 3)."""
    t = (np.arange(1, count + 1) + rng.uniform(-0.25, 0.25, count)) / (count + 1)
    t = _warp(t, float(rng.uniform(-0.5, 0.5)))
    return np.asarray(a + t[:, None] * (b - a))


def _shares(weights: Floats, total: int) -> list[int]:
    """Integers that sum to `total`, in proportion to weights (largest remainder)."""
    exact = weights / weights.sum() * total
    out = np.floor(exact).astype(int)
    rest = np.argsort(out - exact, kind="stable")[: total - int(out.sum())]
    out[rest] += 1
    return [int(n) for n in out]


def tessellated_box(lo: Sequence[float], hi: Sequence[float], triangles: int, seed: int) -> Mesh:
    """Axis-aligned box [lo, hi] of exactly `triangles` (even) faces, irregular on each side."""
    rng = np.random.default_rng(seed)
    low, high = np.asarray(lo, float), np.asarray(hi, float)
    size = high - low
    areas = np.array([size[(k + 1) % 3] * size[(k + 2) % 3] for k in (0, 0, 1, 1, 2, 2)])
    spacing = float(np.sqrt(4.0 / np.sqrt(3.0) * areas.sum() / triangles))
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    blocks = [low + corners * size]
    for axis in range(3):
        count = max(round(size[axis] / spacing) - 1, 0) if triangles > 12 else 0
        for corner in corners[corners[:, axis] == 0]:
            start = low + corner * size
            end = start.copy()
            end[axis] = high[axis]
            blocks.append(_edge_points(start, end, count, rng))
    inner = triangles // 2 + 2 - sum(len(b) for b in blocks)
    if triangles % 2 or inner < 0:
        raise ValueError(f"a box cannot have {triangles} triangles here")
    for side, count in enumerate(_shares(areas, inner)):
        axis, (u, v) = side // 2, ((side // 2 + 1) % 3, (side // 2 + 2) % 3)
        uv = _spread(count, rng, (0.4 * spacing / size[u], 0.4 * spacing / size[v]))
        points = np.empty((count, 3))
        points[:, axis] = (low, high)[side % 2][axis]
        points[:, u], points[:, v] = low[u] + uv[:, 0] * size[u], low[v] + uv[:, 1] * size[v]
        blocks.append(points)
    vertices = np.round(np.concatenate(blocks) / GRID_MM) * GRID_MM
    faces = [_planar_side(vertices, low, high, side) for side in range(6)]
    mesh = vertices, np.concatenate(faces)
    if len(mesh[1]) != triangles:
        raise AssertionError(f"{len(mesh[1])} triangles instead of {triangles}")
    return mesh


def _planar_side(vertices: Floats, low: Floats, high: Floats, side: int) -> Ints:
    """Delaunay triangles of the vertices on one side of a box; side = 2 axis + (1 if upper)."""
    axis, upper = side // 2, side % 2
    ids = np.flatnonzero(vertices[:, axis] == (high if upper else low)[axis])
    flat = vertices[ids][:, [(axis + 1) % 3, (axis + 2) % 3]]
    tri = Delaunay(flat).simplices
    a, b, c = (flat[tri[:, k]] for k in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    tri, doubled = tri[doubled != 0.0], doubled[doubled != 0.0]
    wrong = (doubled < 0.0) == bool(upper)
    tri[wrong] = tri[wrong][:, ::-1]
    return np.asarray(ids[tri], dtype=np.int64)


def ball(radius_mm: float, subdivisions: int) -> Mesh:
    """Icosphere with its vertices on the sphere: 20 * 4^subdivisions triangles."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_mm)
    return np.asarray(made.vertices), np.asarray(made.faces)


def cylinder_y(radius_mm: float, length_mm: float, sides: int, rings: int) -> Mesh:
    """Cylinder about the y axis, centred at the origin: 2 sides rings + 2 (sides - 2) triangles."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([radius_mm * np.sin(angle), np.zeros(sides), radius_mm * np.cos(angle)])
    levels = np.linspace(-0.5, 0.5, rings + 1) * length_mm
    vertices = np.concatenate([ring + np.array([0.0, y, 0.0]) for y in levels])
    faces = []
    for r in range(rings):
        for i in range(sides):
            a, b = r * sides + i, r * sides + (i + 1) % sides
            c, d = a + sides, b + sides
            faces += [[a, b, d], [a, d, c]] if (i + r) % 2 else [[a, b, c], [b, d, c]]
    top = rings * sides
    for i in range(1, sides - 1):
        faces += [[0, i + 1, i], [top, top + i, top + i + 1]]
    return _outward(vertices, np.array(faces, dtype=np.int64))


def _outward(vertices: Floats, faces: Ints) -> Mesh:
    """The same mesh with positive volume."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return vertices, faces if volume > 0.0 else np.ascontiguousarray(faces[:, ::-1])


def from_manifold(solid: mf.Manifold) -> Mesh:
    """Vertices and faces of a manifold3d solid."""
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts, np.int64)


def prism_y(profile_xz: Sequence[tuple[float, float]], y0: float, y1: float) -> Mesh:
    """Solid with the given outline in the x-z plane, from y0 to y1; the coarsest tessellation."""
    outline = np.array(profile_xz, float)
    if not Polygon(outline).exterior.is_ccw:
        outline = outline[::-1]
    vertices, faces = from_manifold(mf.CrossSection([outline]).extrude(y1 - y0))
    return np.column_stack([vertices[:, 0], y1 - vertices[:, 2], vertices[:, 1]]), faces


def wedge(angle_deg: float, face_mm: float = 120.0) -> Mesh:
    """Wedge of this interior angle below its edge, the y axis; symmetric about x = 0."""
    half = np.radians(angle_deg / 2.0)
    x, z = float(face_mm * np.sin(half)), float(-face_mm * np.cos(half))
    return prism_y([(0.0, 0.0), (-x, z), (x, z)], -80.0, 80.0)


def tapered_bar() -> Mesh:
    """Bar along y, 40 mm wide, 30 mm high, with a 36 mm wide nose at y < -40 (5.7 deg lead-in)."""
    outline = [(-18.0, -80.0), (18.0, -80.0), (18.0, -40.0), (20.0, -20.0), (20.0, 80.0)]
    outline += [(-20.0, 80.0), (-20.0, -20.0), (-18.0, -40.0)]
    vertices, faces = from_manifold(mf.CrossSection([np.array(outline)]).extrude(30.0))
    return vertices - [0.0, 0.0, 15.0], faces


def u_tool() -> Mesh:
    """Fork open towards -z: legs 10 mm thick with a 38 mm gap, 30 mm along y; origin in the gap."""
    outline = [(-29.0, -20.0), (-19.0, -20.0), (-19.0, 25.0), (19.0, 25.0), (19.0, -20.0)]
    outline += [(29.0, -20.0), (29.0, 35.0), (-29.0, 35.0)]
    return prism_y(outline, -15.0, 15.0)


def hole_block() -> Mesh:
    """Block 60 x 60 x 30 mm, top at z = 0, with a through hole R 10 mm about z (96 sides)."""
    block = mf.Manifold.cube([60.0, 60.0, 30.0], True).translate([0.0, 0.0, -15.0])
    drill = mf.Manifold.cylinder(40.0, 10.0, 10.0, 96, True).translate([0.0, 0.0, -15.0])
    return from_manifold(block - drill)


def peg() -> Mesh:
    """Peg of R 9.8 mm, 40 mm long, about the z axis, centred at the origin (96 sides)."""
    return from_manifold(mf.Manifold.cylinder(40.0, 9.8, 9.8, 96, True))


def screwdriver() -> Mesh:
    """Screwdriver along x: flat blade at x = 110 mm, shaft R 3 mm from x = 0, handle R 13 mm behind (48 sides)."""
    outline = [
        (0.0, -95.0),
        (11.0, -95.0),
        (13.0, -90.0),
        (13.0, -25.0),
        (9.0, -12.0),
        (9.0, -4.0),
        (5.0, 0.0),
    ]
    outline += [(3.0, 0.0), (3.0, 110.0), (0.0, 110.0)]
    body = mf.CrossSection([np.array(outline)]).revolve(48)
    side = np.array([(20.0, -100.0), (20.0, 60.0), (3.5, 85.0), (0.5, 111.0)])
    taper = mf.CrossSection([np.concatenate([side, side[::-1] * [-1.0, 1.0]])])
    blade = taper.extrude(60.0).translate([0.0, 0.0, -30.0]).rotate([90.0, 0.0, 0.0])
    return from_manifold((body ^ blade).rotate([0.0, 90.0, 0.0]))


def stylus() -> Mesh:
    """Cone with its tip at the origin, 15 mm along z, half angle 25 degrees (24 sides): touches with a point."""
    outline = [(0.0, 0.0), (15.0 * np.tan(np.radians(25.0)), 15.0), (0.0, 15.0)]
    return from_manifold(mf.CrossSection([np.array(outline)]).revolve(24))


def spanner(dxf: Path) -> Mesh:
    """Outline of wrench.dxf (inch) extruded to 8 mm, centred at the origin: 448 triangles."""
    polygon = trimesh.load_path(str(dxf)).polygons_full[0]
    rings = [np.asarray(r.coords)[:-1] for r in (polygon.exterior, *polygon.interiors)]
    centre = (rings[0].min(axis=0) + rings[0].max(axis=0)) / 2.0
    section = mf.CrossSection([(r - centre) * INCH_MM for r in rings], mf.FillRule.EvenOdd)
    vertices, faces = from_manifold(section.extrude(8.0))
    return vertices - [0.0, 0.0, 4.0], faces


def feature_part(stl: Path) -> Mesh:
    """Machined part featuretype.STL, scaled from inch to mm; order of the triangles kept.

    Its corners agree to 1e-15 inch only (some zeros are not zero): welded on a grid of 1e-6 mm.
    """
    raw = np.fromfile(stl, dtype=STL_RECORD, offset=84)["corners"].reshape(-1, 3)
    corners = np.round(raw.astype(float) * INCH_MM, 6) + 0.0
    vertices, inverse = np.unique(corners, axis=0, return_inverse=True)
    return vertices, np.asarray(inverse, np.int64).reshape(-1, 3)
