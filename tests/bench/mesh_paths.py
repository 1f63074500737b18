"""A path of a tool over every ridge and pocket of a part, made from the part's own creases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crease.bake.surface import Surface
from crease.base.attitude import to_matrix
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PLACES = 16
"""Ridges and pockets each, and smooth places where there are none, as far from each other as they get."""
DEPTH_MM = 0.6
"""How deep the deepest sample of the tool goes."""
HALF_MM, KEY_MM, STEP_MM = 3.0, 0.25, 0.05
"""A stroke goes from HALF_MM before a crease to HALF_MM behind it, KEY_MM between heights, STEP_MM a tick."""
LIFT_MM = 1.2
STEEP = 4.0
"""A height that changes by more than this times the way ends the stroke: there the tool would run into a wall."""
POINTS = 900
SEED = 13


@dataclass(frozen=True)
class Place:
    """Where a stroke goes: the middle, up from the part, across; unit vectors (3,), lengths in mm."""

    at_mm: Floats
    up: Floats
    across: Floats


def spread(points: Floats, count: int) -> NDArray[np.int64]:
    """Indices of points (n, 3) that are as far from each other as they get, the first first."""
    chosen = [0]
    away = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(away)))
    return np.array(chosen)


def places(surface: Surface) -> list[Place]:
    """Convex creases, concave creases, and smooth places when there are few of either."""
    creases = surface.creases
    vertices = 1e3 * surface.mesh.vertices_m
    corners = vertices[surface.mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-300)[:, None]
    found: list[Place] = []
    middle = 1e3 * creases.ends_m.mean(axis=1)
    along = 1e3 * (creases.ends_m[:, 1] - creases.ends_m[:, 0])
    for convex in (True, False):
        mine = np.flatnonzero(creases.convex == convex)
        for i in mine[spread(middle[mine], PLACES)] if len(mine) else ():
            up = _outward(surface, middle[i], along[i])
            found.append(Place(middle[i], up, _unit(np.cross(along[i], up))))
    if len(found) < PLACES:
        rng = np.random.default_rng(SEED)
        centre = corners.mean(axis=1)
        some = rng.choice(len(area), min(4000, len(area)), p=area / area.sum(), replace=False)
        for i in some[spread(centre[some], PLACES)]:
            side = np.eye(3)[int(np.argmin(np.abs(normal[i])))]
            found.append(Place(centre[i], normal[i], _unit(np.cross(normal[i], side))))
    return found


def _outward(surface: Surface, at_mm: Floats, along: Floats) -> Floats:
    """The direction across a crease in which the part is farthest away: up between its two faces."""
    first = _unit(np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))]))
    second = np.cross(_unit(along), first)
    turn = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
    ways = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
    phi, _ = surface.signed_distance(1e-3 * (at_mm + 0.2 * ways))
    best = phi >= phi.max() - 1e-6
    return _unit(ways[best].mean(axis=0) if best.sum() < 40 else ways[int(np.argmax(phi))])


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def points_of(vertices_mm: Floats, triangles: NDArray[np.int32]) -> Floats:
    """Vertices of the tool, thinned out, and points of its faces."""
    rng = np.random.default_rng(SEED)
    corners = vertices_mm[triangles]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    which = rng.choice(len(area), POINTS, p=area / area.sum())
    uv = np.sort(rng.random((POINTS, 2)), axis=1)
    weight = np.column_stack([uv[:, 0], uv[:, 1] - uv[:, 0], 1.0 - uv[:, 1]])
    inner = np.einsum("nk,nkx->nx", weight, corners[which])
    return np.concatenate([inner, vertices_mm[:: max(1, len(vertices_mm) // POINTS)]])


def _attitude(place: Place, tilt: Floats) -> Floats:
    """Quaternion (4,) that turns the tool's z axis up, after a tilt given as a rotation vector."""
    from scipy.spatial.transform import Rotation

    third = _unit(np.cross(place.across, place.up))
    frame = Rotation.from_matrix(np.column_stack([place.across, -third, place.up]))
    x, y, z, w = (frame * Rotation.from_rotvec(tilt)).as_quat()
    return np.array([w, x, y, z])


def _heights(surface: Surface, tool: Floats, place: Place, at: Floats, far_mm: float) -> Floats:
    """How far up the tool's origin is, over each of at (n, 3), when its deepest point is DEPTH_MM deep; NaN: never.

    From far outside, by as much as the nearest point allows: the tool cannot pass through a wall.
    """
    height = np.full(len(at), far_mm)
    open_ = np.ones(len(at), bool)

    def least(rows: NDArray[np.int64]) -> Floats:
        moved = at[rows, None] + height[rows, None, None] * place.up + tool[None]
        phi, _ = surface.signed_distance(1e-3 * moved.reshape(-1, 3))
        return np.asarray(1e3 * phi.reshape(len(rows), -1).min(axis=1))

    for _ in range(60):
        rows = np.flatnonzero(open_)
        if len(rows) == 0:
            break
        way = least(rows) + DEPTH_MM
        height[rows] -= way
        open_[rows] = way > 0.01
        height[height < -far_mm] = np.nan
        open_ &= np.isfinite(height)
    height[open_] = np.nan
    return height


def stroke(surface: Surface, tool: Floats, place: Place, quaternion: Floats) -> Floats:
    """Poses (n, 7), mm, of a stroke over a place: down, across, up; none where the tool does not get to it."""
    turned = tool @ to_matrix(quaternion).T
    far_mm = 1e3 * float(np.ptp(surface.mesh.vertices_m, axis=0).max()) + float(
        2 * np.linalg.norm(tool, axis=1).max()
    )
    side = np.arange(-HALF_MM, HALF_MM + 1e-9, KEY_MM)
    at = place.at_mm + side[:, None] * place.across
    height = _heights(surface, turned, place, at, far_mm)
    steep = ~np.isfinite(height[1:] + height[:-1]) | (np.abs(np.diff(height)) > STEEP * KEY_MM)
    middle = len(side) // 2
    if not np.isfinite(height[middle]):
        return np.zeros((0, 7))
    before, behind = np.flatnonzero(steep[:middle]), np.flatnonzero(steep[middle:])
    first = int(before[-1]) + 1 if len(before) else 0
    last = middle + int(behind[0]) if len(behind) else len(side) - 1
    keys = at[first : last + 1] + height[first : last + 1, None] * place.up
    keys = np.concatenate([keys[:1] + LIFT_MM * place.up, keys, keys[-1:] + LIFT_MM * place.up])
    spent = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(keys, axis=0), axis=1))])
    ticks = np.linspace(0.0, spent[-1], int(np.ceil(spent[-1] / STEP_MM)) + 1)
    moved = np.column_stack([np.interp(ticks, spent, keys[:, k]) for k in range(3)])
    return np.hstack([moved, np.tile(quaternion, (len(moved), 1))])


def strokes(surface: Surface, vertices_mm: Floats, triangles: NDArray[np.int32]) -> list[Floats]:
    """A stroke over every place that the tool gets to."""
    tool, rng = points_of(vertices_mm, triangles), np.random.default_rng(SEED)
    made = [
        stroke(surface, tool, place, _attitude(place, rng.normal(0.0, 0.25, 3)))
        for place in places(surface)
    ]
    return [poses for poses in made if len(poses)]
