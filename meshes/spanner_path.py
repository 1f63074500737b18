"""The spanner's path over the machined part: key poses held back by a coarse distance field."""

from __future__ import annotations

import manifold3d as mf
import numpy as np
import paths
import shapely
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from shapes import Mesh

Floats = NDArray[np.float64]

CELL_MM = 0.5
MARGIN_MM = 6.0
SAMPLE_MM = 1.2
GUIDE_TICKS = 4500
DEPTH_MM = 0.7
# Middle of the spanner's notched end, tool frame: the point the keys below place.
TIP_MM = np.array([-41.0, -3.6, 0.0])

# x, y, z of the tip (mm, part frame); yaw, pitch, roll of the spanner (deg). A positive pitch
# lowers the tip.
KEYS = [
    (-56, 0, 34, 180, 45, 0),  # above the open slot
    (-56, 0, 14.5, 180, 45, 2),  # its floor
    (-52, -2, 14.2, 178, 44, 4),
    (-48.8, -3, 14.5, 176, 44, 4),  # its end wall: floor and wall meet in a concave crease
    (-50, 4, 14.5, 172, 44, 0),
    (-52, 10, 14.5, 168, 45, -4),
    (-53, 12.5, 15, 165, 45, -5),  # its side wall
    (-53, 12.5, 22, 165, 46, -5),  # up the wall
    (-54, 16, 28.5, 160, 48, 0),  # over its edge
    (-55, 20, 27.5, 155, 50, 20),  # top face
    (-57, 24, 26, 150, 54, 40),  # one prong into the counterbore
    (-56, 25, 25, 150, 56, 42),
    (-52, 24, 27, 152, 52, 30),  # out over its rim
    (-46, 18, 34, 158, 55, 10),
    (-34, 6, 42, 165, 58, 0),
    (-27, 1, 36, 172, 62, 0),  # above the left boss pocket
    (-26, 0, 31, 176, 62, 0),  # its floor
    (-24, 0.5, 31, 178, 62, 3),
    (-22, 1.5, 31.2, 178, 61, 3),  # its wall
    (-22, 2.5, 35, 176, 60, 0),
    (-18, 6, 37, 174, 52, 0),  # over its edge, across the boss
    (-10, 16, 37.5, 176, 34, 0),
    (-8, 26, 33, 178, 12, 1),  # off the boss
    (-6, 28.5, 28.9, 179, 1.5, 0.5),  # laid flat on the top face beside it
    (-2, 27.4, 28.6, 180, 0.7, 0),  # a knuckle of the outline against the boss wall
    (8, 27.1, 28.6, 180, 0.7, 0.5),
    (16, 27.5, 34, 174, 10, 0),
    (40, 14, 36, 145, 38, 0),
    (55, 5, 30, 115, 52, 0),
    (59.5, 2, 18.2, 104, 58, 0),  # floor of the pocket at the right-hand end
    (59.5, -1, 17.8, 102, 58, 4),
    (57.5, -3, 17.8, 100, 58, 2),  # its long wall
    (57.5, -7, 18, 96, 57, 2),  # its short wall
    (58, -8, 22, 94, 56, 0),  # over the edge of the wall
    (58, -13, 24, 93, 55, 0),
    (58, -16, 30, 92, 54, 0),
    (60, -18, 46, 92, 50, 0),
]


def _solid(mesh: Mesh) -> mf.Manifold:
    vertices, faces = mesh
    return mf.Manifold(mf.Mesh(vertices.astype(np.float32), faces.astype(np.uint32)))


def distance_field(mesh: Mesh) -> paths.Field:
    """Coarse signed distance of a solid, from its plane sections."""
    low = mesh[0].min(axis=0) - MARGIN_MM
    shape = np.ceil((mesh[0].max(axis=0) + MARGIN_MM - low) / CELL_MM).astype(int) + 1
    xs, ys = (low[k] + CELL_MM * np.arange(shape[k]) for k in range(2))
    gx, gy = np.meshgrid(xs, ys, indexing="ij")
    solid = _solid(mesh)
    inside = np.zeros(tuple(shape), dtype=bool)
    for level in range(shape[2]):
        # A little off the grid, so that no section coincides with a horizontal face.
        loops = solid.slice(float(low[2] + CELL_MM * level) + 0.013).to_polygons()
        region: shapely.Geometry = shapely.Polygon()
        for loop in loops:
            region = region.symmetric_difference(shapely.Polygon(loop))
        shapely.prepare(region)
        inside[:, :, level] = shapely.contains_xy(region, gx, gy)
    return paths.Field(inside, low, CELL_MM)


def surface_samples(mesh: Mesh) -> Floats:
    """Vertices of the tool refined to SAMPLE_MM, (n, 3) mm."""
    fine = _solid(mesh).refine_to_length(SAMPLE_MM).to_mesh().vert_properties[:, :3]
    return np.asarray(fine, float)


def part_spanner_path(part: Mesh, spanner: Mesh) -> paths.Path:
    """Path of about 4000 ticks: starts and ends in free space, the tool is about DEPTH_MM deep."""
    u = np.linspace(0.0, 1.0, GUIDE_TICKS)
    keys = paths.keyed(KEYS, u)
    attitude = Rotation.from_euler("ZYX", keys[:, 3:] * [1.0, -1.0, 1.0], degrees=True)
    guide = keys[:, :3] - attitude.apply(TIP_MM)
    return paths.pressed(distance_field(part), surface_samples(spanner), guide, attitude, DEPTH_MM)
