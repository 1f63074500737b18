"""Tool paths of the test scenes: poses world_from_tool in the frame of the static object.

A path is a pair (positions_mm (n, 3), Rotation of length n) sampled at one tick per row: no tick
moves the tool origin by more than STEP_MM or turns it by more than STEP_DEG.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import distance_transform_edt, gaussian_filter1d
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation, Slerp

Floats = NDArray[np.float64]
Path = tuple[Floats, Rotation]
Keys = Sequence[Sequence[float]]

STEP_MM = 0.1
STEP_DEG = 0.1
# A hand moves smoothly: kinks of a geometric construction are rounded over some 2 mm.
SMOOTH_TICKS = 10.0
FINE = 1500


def keyed(keys: Keys, u: Floats) -> Floats:
    """Smooth curve without overshoot through `keys` (k, d), at parameters u in [0, 1]: (n, d)."""
    values = np.asarray(keys, float)
    return np.asarray(PchipInterpolator(np.linspace(0.0, 1.0, len(values)), values)(u))


def turned(keys_deg: Keys, u: Floats) -> Rotation:
    """Attitudes through rotation vectors in degrees (k, 3), at parameters u in [0, 1]."""
    return Rotation.from_rotvec(np.radians(keyed(keys_deg, u)))


def ticks(position_mm: Floats, attitude: Rotation, smooth: float = SMOOTH_TICKS) -> Path:
    """The same path at one sample per tick, constant speed in the stricter of both step limits."""
    moved = np.linalg.norm(np.diff(position_mm, axis=0), axis=1) / STEP_MM
    swung = np.degrees((attitude[:-1].inv() * attitude[1:]).magnitude()) / STEP_DEG
    spent = np.concatenate([[0.0], np.cumsum(np.maximum(np.maximum(moved, swung), 1e-9))])
    count = int(np.ceil(spent[-1])) + 1
    at = np.linspace(0.0, spent[-1], count)
    position = np.column_stack([np.interp(at, spent, position_mm[:, k]) for k in range(3)])
    if smooth > 0.0:
        position = gaussian_filter1d(position, smooth, axis=0, mode="nearest")
    return position, Slerp(spent, attitude)(at)


def still(position_mm: Floats) -> Rotation:
    """Identity attitude for every sample."""
    return Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (len(position_mm), 1)))


def dragged(
    static: Floats, tool: Floats, keys: dict[str, Keys], smooth: float = SMOOTH_TICKS
) -> Path:
    """A convex tool dragged over a convex obstacle with a prescribed depth.

    static, tool: hull vertices, (n, 3) mm. keys: 'track' points inside the obstacle below the tool
    origin; 'up' directions along which depth is measured; 'depth' in mm (negative: clear); 'turn'
    rotation vectors in degrees. The tool origin is put on the ray track + t up so that a withdrawal
    of exactly `depth` along up separates both.
    """
    u = np.linspace(0.0, 1.0, FINE)
    attitude = turned(keys["turn"], u)
    track, up = keyed(keys["track"], u), keyed(keys["up"], u)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    depth = keyed(keys["depth"], u)[:, 0]
    position = np.empty((FINE, 3))
    for i in range(FINE):
        sums = (static[:, None, :] - attitude[i].apply(tool)[None, :, :]).reshape(-1, 3)
        planes = np.unique(ConvexHull(sums).equations, axis=0)
        ahead = planes[:, :3] @ up[i]
        reach = -(planes[:, :3] @ track[i] + planes[:, 3])
        leave = float(np.min(reach[ahead > 1e-12] / ahead[ahead > 1e-12]))
        position[i] = track[i] + (leave - depth[i]) * up[i]
    return ticks(position, attitude, smooth)


def edge_sphere(radius_mm: float, depth_mm: float) -> Path:
    """Ball `depth_mm` deep along the top face, round the edge x = z = 0, down the side face."""
    reach = radius_mm - depth_mm
    arc = np.linspace(0.0, np.pi / 2.0, 2000)[1:-1]
    corners = [[-60.0, radius_mm + 5.0], [-60.0, reach], [0.0, reach]]
    arcs = np.column_stack([reach * np.sin(arc), reach * np.cos(arc)])
    tail = [[reach, 0.0], [reach, -50.0], [radius_mm + 5.0, -50.0]]
    flat = np.concatenate([corners, arcs, tail])
    position = np.column_stack([flat[:, 0], np.full(len(flat), 3.7), flat[:, 1]])
    return ticks(position, still(position), smooth=0.0)


def corner_ball(radius_mm: float, depth_mm: float) -> Path:
    """Ball over the negative octant: face z = 0, its edge with x = 0, corner, edge, face y = 0."""
    u = np.linspace(0.0, 1.0, FINE)
    guide = keyed(
        [[-32, -34, 15], [-18, -34, 15], [-3, -30, 15], [9, -24, 12], [10, -12, 11], [9, -1, 10],
         [7, 7, 9], [1, 11, 8], [-10, 12, 7], [-18, 14, -3], [-24, 15, -14], [-34, 15, -26]], u
    )  # fmt: skip
    depth = keyed([[-3.0]] + [[depth_mm]] * 10 + [[-3.0]], u)
    foot = np.minimum(guide, 0.0)
    out = (guide - foot) / np.linalg.norm(guide - foot, axis=1, keepdims=True)
    position = foot + (radius_mm - depth) * out
    return ticks(position, still(position))


def cylinder_ball(cylinder_mm: float, ball_mm: float, depth_mm: float) -> Path:
    """Ball over a cylinder about the y axis: across its top, along it, back on a slant."""
    u = np.linspace(0.0, 1.0, FINE)
    depth = keyed([[-3.0], [depth_mm], [depth_mm], [1.3 * depth_mm], [depth_mm], [-3.0]], u)[:, 0]
    angle = np.radians(keyed([[-50], [-30], [20], [40], [0], [-35]], u)[:, 0])
    along = keyed([[-30], [-25], [-12], [10], [30], [38]], u)[:, 0]
    reach = cylinder_mm + ball_mm - depth
    position = np.column_stack([reach * np.sin(angle), along, reach * np.cos(angle)])
    return ticks(position, still(position))


def posed(positions_mm: Keys, turns_deg: Keys) -> Path:
    """Path through key positions and key attitudes."""
    u = np.linspace(0.0, 1.0, FINE)
    return ticks(keyed(positions_mm, u), turned(turns_deg, u))


class Field:
    """Signed distance of a solid on a regular grid (mm, positive outside); good to half a cell."""

    def __init__(self, inside: NDArray[np.bool_], origin_mm: Floats, cell_mm: float) -> None:
        """inside: (nx, ny, nz); node (0, 0, 0) lies at origin_mm (3,)."""
        out = distance_transform_edt(~inside) - distance_transform_edt(inside)
        self._phi = (out * cell_mm).astype(np.float64)
        self._slope = np.stack(np.gradient(self._phi, cell_mm), axis=-1)
        self._origin, self._cell = origin_mm, cell_mm

    def at(self, points_mm: Floats) -> tuple[Floats, tuple[NDArray[np.int64], ...]]:
        """Distance at points (n, 3), trilinear, and their cell indices."""
        where = (points_mm - self._origin) / self._cell
        limit = np.array(self._phi.shape) - 1.001
        where = np.clip(where, 0.0, limit)
        base = where.astype(np.int64)
        frac = where - base
        total = np.zeros(len(points_mm))
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, frac, 1.0 - frac), axis=1)
            total += weight * self._phi[tuple((base + corner).T)]
        return total, tuple(base.T)

    def slope(self, cell: tuple[int, ...]) -> Floats:
        """Unit gradient at a cell."""
        g = self._slope[cell]
        return np.asarray(g / max(float(np.linalg.norm(g)), 1e-9))


def pressed(
    field: Field, samples_mm: Floats, guide_mm: Floats, attitude: Rotation, depth_mm: float
) -> Path:
    """The guide path, held back so that no tool sample is deeper than about `depth_mm`.

    samples_mm: tool surface samples (n, 3), tool frame. The tool follows the guide by at most
    STEP_MM per sample and is then pushed out along the gradient at its deepest sample until nothing
    is too deep.
    """
    held = np.empty_like(guide_mm)
    p = guide_mm[0].copy()
    for i, target in enumerate(guide_mm):
        pull = target - p
        p = p + pull * min(1.0, STEP_MM * 1.5 / max(float(np.linalg.norm(pull)), 1e-12))
        turned_samples = attitude[i].apply(samples_mm)
        phi, _ = field.at(turned_samples + p)
        near = turned_samples[phi < 4.0]
        for _ in range(12):
            if not len(near):
                break
            phi, cells = field.at(near + p)
            worst = int(np.argmin(phi))
            excess = -depth_mm - float(phi[worst])
            if excess <= 0.01:
                break
            p = p + 0.7 * excess * field.slope(tuple(int(c[worst]) for c in cells))
        held[i] = p
    return ticks(gaussian_filter1d(held, 12.0, axis=0, mode="nearest"), attitude)
