"""How far the finished image's distances are from the exact ones, measured with the firmware's own lookup."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from crease.bake.grid import Grid, brick_points
from crease.bake.kinds import distance_of_kind
from crease.bake.surface import Surface
from crease.bake.voxmap import Voxmap
from crease.base.native import ffi, lib
from crease.base.scene import open_image

F64 = npt.NDArray[np.float64]

PROBES = 40_000
"""Points compared near the surface, and as many anywhere in the near bricks."""
SAFETY = 1.5
"""The margins of the skips are this times the largest errors measured: probes may miss the worst point."""
SEED = 20070101


def surface_probes(surface: Surface, near_m: float, count: int) -> F64:
    """Points within near_m of the surface, half of them next to creases. Shape (count, 3); the same every time."""
    rng = np.random.default_rng(SEED)
    v = surface.mesh.vertices_m[surface.mesh.triangles]
    area = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1)
    which = rng.choice(len(v), count, p=area / area.sum())
    uv = rng.random((count, 2))
    uv = np.where(uv.sum(axis=1, keepdims=True) > 1, 1 - uv, uv)
    side = v[which, 1:] - v[which, :1]
    points = v[which, 0] + np.einsum("nk,nkx->nx", uv, side)
    ends = surface.creases.ends_m
    if len(ends):
        half = count // 2
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        edge = rng.choice(len(ends), half, p=length / length.sum())
        points[:half] = ends[edge, 0] + rng.random((half, 1)) * (ends[edge, 1] - ends[edge, 0])
    offset = rng.normal(size=(count, 3))
    offset *= near_m * rng.random((count, 1)) / np.linalg.norm(offset, axis=1, keepdims=True)
    return np.asarray(points + offset)


def brick_probes(grid: Grid, top: npt.NDArray[np.uint32], count: int) -> F64:
    """Points anywhere in the near bricks. Shape (count, 3); the same every time."""
    rng = np.random.default_rng(SEED)
    near = np.flatnonzero((top & np.uint32(lib.CR_TOP_FAR)) == 0)
    index = rng.choice(near, count)
    x, y = index % grid.dims[0], index // grid.dims[0] % grid.dims[1]
    z = index // (grid.dims[0] * grid.dims[1])
    where = np.column_stack([x, y, z]) + rng.random((count, 3))
    return np.asarray(brick_points(grid, where, np.zeros((1, 3)))[:, 0])


def look_up(
    image: npt.NDArray[np.uint8], points: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Distances that the tick would see at points (n, 3)."""
    scene = open_image(image.tobytes(), "new image")
    phi, gradient = np.empty(len(points), np.float32), np.empty(points.shape, np.float32)
    kind, facet = np.empty(len(points), np.uint32), np.empty(len(points), np.uint32)
    lib.crp_look_up(
        scene.handle,
        ffi.from_buffer("float[]", points.reshape(-1)),
        len(points),
        ffi.from_buffer("float[]", phi),
        ffi.from_buffer("float[]", gradient.reshape(-1)),
        ffi.from_buffer("uint32_t[]", kind),
        ffi.from_buffer("uint32_t[]", facet),
    )
    return phi


def planes_error(voxmap: Voxmap, points: F64, exact: F64) -> F64:
    """How far the planes of each point's brick are off, 0 where it has none. Shapes: points (n, 3), exact (n,)."""
    grid = voxmap.grid
    where = np.floor((points - grid.origin_m) / grid.brick_m).astype(np.int64)
    x, y, z = np.clip(where, 0, np.array(grid.dims) - 1).T
    entry = voxmap.top[(z * grid.dims[1] + y) * grid.dims[0] + x]
    near = (entry & np.uint32(lib.CR_TOP_FAR)) == 0
    kind = np.where(near, voxmap.bricks["planes"][np.where(near, entry, 0)], 0)
    error = np.zeros(len(points))
    for index in np.unique(kind[kind > 0]):
        mine = kind == index
        value = distance_of_kind(voxmap.kinds[index], voxmap.facets, points[mine])
        error[mine] = value - exact[mine]
    return error


def measure_errors(
    image: npt.NDArray[np.uint8], surface: Surface, voxmap: Voxmap
) -> dict[str, float]:
    """The error fields of the image's meta section, in m, for the worse of a lookup and the planes of the brick.

    error_max_m, error_rms_m: near the surface. error_out_m, error_in_m: how far a distance may overstate the way to the
    surface (anywhere, outside and inside) plus how far one near the surface may be off: what a skip leaves room for.
    """
    grid = voxmap.grid
    points = np.concatenate(
        [surface_probes(surface, grid.near_m, PROBES), brick_probes(grid, voxmap.top, PROBES)]
    )
    points = points.astype(np.float32)
    exact, _ = surface.signed_distance(points.astype(np.float64))
    looked_up = look_up(image, points) - exact
    by_planes = planes_error(voxmap, points.astype(np.float64), exact)
    error = np.where(np.abs(by_planes) > np.abs(looked_up), by_planes, looked_up)
    near = np.abs(exact[:PROBES]) < grid.near_m
    near_error = np.abs(error[:PROBES][near])
    worst = float(near_error.max())
    over_out = float(error[exact > 0].max(initial=0.0))
    over_in = float(-error[exact < 0].min(initial=0.0))
    return {
        "error_max_m": worst,
        "error_rms_m": float(np.sqrt((near_error**2).mean())),
        "error_out_m": SAFETY * (worst + over_out),
        "error_in_m": SAFETY * (worst + over_in),
    }
