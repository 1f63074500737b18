"""The faces of a tool as near-uniform pieces: positions, area vectors that add up, second moments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crease.bake.gather import I32, FinePoints, Gathered
from crease.bake.reflex import ReflexCorners, cut_at, reflex_corners
from crease.bake.surface import Surface
from crease.bake.vectors import F64, I64, unit
from crease.base.progress import part_of

Tick = Callable[[float], None]

DENSE_PER_SAMPLE = 24
"""Points of the fine sampling that each shell sample stands for."""
LLOYD_STEPS = 12
"""Relaxation steps towards a centroidal Voronoi tessellation; more changes the quadrature error by under 5 %."""
NORMAL_WEIGHT = 1.5
"""How far apart, in spacings, two normals at right angles are held: keeps samples off sharp edges."""
FLAT = 1e-5
"""A piece that bends by less than this share of the spacing is flat: rounding of the mesh."""
PART_MAX = 0.25
"""Of even cells: a part of a triangle is no longer than this share of the spacing."""


def without_slim(corners: F64, area_m2: float, length_m: float) -> tuple[F64, I64]:
    """Triangles (n, 3, 3) halved across while parts of at most area_m2 are longer than length_m; whose each is."""
    owner = np.arange(len(corners))
    short, owners = [], []
    while len(corners):
        side = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        parts = np.maximum(_parts_a_side(_areas_m2(corners), area_m2), 1)
        slim = side.max(axis=1) > length_m * parts
        short.append(corners[~slim])
        owners.append(owner[~slim])
        corners, owner, longest = corners[slim], owner[slim], side[slim].argmax(axis=1)
        a, b, c = (corners[np.arange(len(corners)), (longest + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.stack([a, middle, c, middle, b, c], axis=1).reshape(-1, 3, 3)
        owner = np.repeat(owner, 2)
    return np.concatenate(short), np.concatenate(owners)


def _areas_m2(corners: F64) -> F64:
    """Of triangles, as vectors (n, 3)."""
    return np.asarray(0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _parts_a_side(normal: F64, area_m2: float) -> I64:
    """Of triangles that are cut into equal parts of at most area_m2, (n,)."""
    return np.asarray(np.ceil(np.sqrt(np.linalg.norm(normal, axis=1) / area_m2)), np.int64)


def fine_points(corners: F64, area_m2: float) -> FinePoints:
    """Triangles (n, 3, 3), each cut into k^2 equal parts of at most area_m2, those with the fewest parts first."""
    normal = _areas_m2(corners)
    parts = _parts_a_side(normal, area_m2)
    position, owner = [], []
    for k in np.unique(parts[parts > 0]):
        chosen = np.flatnonzero(parts == k)
        weights = _part_weights(int(k))
        position.append(np.einsum("wc,tcx->twx", weights, corners[chosen]).reshape(-1, 3))
        owner.append(np.repeat(chosen.astype(np.int32), k**2))
    area = normal / np.maximum(parts, 1)[:, None] ** 2
    return FinePoints(
        np.concatenate(position),
        np.concatenate(owner),
        unit(area),
        area,
        np.linalg.norm(area, axis=1),
    )


def _part_weights(k: int) -> F64:
    """Barycentric centroids of the k^2 equal parts of a triangle, (k^2, 3)."""
    rows = []
    for i in range(k):
        for j in range(k - i):
            rows.append((i + 1 / 3, j + 1 / 3))
            if i + j < k - 1:
                rows.append((i + 2 / 3, j + 2 / 3))
    uv = np.array(rows) / k
    return np.column_stack([1 - uv.sum(axis=1), uv])


@dataclass(frozen=True)
class Cells:
    """Near-uniform pieces of surface. Shapes: position_m, area_m2 (vectors) (n, 3); spread_m2 (n, 3, 3); rest (n,)."""

    position_m: F64
    area_m2: F64
    spread_m2: F64
    bow_m: F64
    patch: I64


def relax(
    fine: FinePoints,
    corners: ReflexCorners,
    patch: int,
    spacing_m: float,
    tick: Tick,
    even: bool = False,
) -> Cells:
    """Fine points of one patch gathered into cells: positions on the surface, area vectors that add up, and the
    second moment of each cell about its middle.

    A centroidal Voronoi tessellation in the space of position and weighted normal, cut at the patch's reflex corners:
    the second moment of a cell round one is that of a parallelogram across the hollow. even: as many cells as the area
    says; boxes that lie across a surface give up to twice that.
    """
    points = Gathered(fine, NORMAL_WEIGHT * spacing_m, spacing_m)
    label = first_cells(fine, spacing_m)
    if even:
        asked = float(fine.weight_m2[fine.triangle].sum()) / spacing_m**2
        label = first_cells(fine, spacing_m * max(1.0, float(np.sqrt((label.max() + 1) / asked))))
    for step in range(LLOYD_STEPS):
        label = without_gaps(points.nearest(points.means(label), label))
        tick((step + 1) / LLOYD_STEPS)
    label = cut_at(corners, fine.position_m, label, spacing_m)
    middle = np.ascontiguousarray(points.means(label)[:, :3])
    own = fine.area_m2[fine.triangle]
    area = np.column_stack([np.bincount(label, own[:, k]) for k in range(3)]).astype(np.float64)
    direction = unit(area)
    near = points.closest(middle, label)
    lift = np.einsum("nx,nx->n", fine.position_m[near] - middle, direction)
    spread = points.spreads(middle, label)
    site = middle + lift[:, None] * direction
    bow = points.bows(site, direction, label)
    bow[bow < FLAT * spacing_m] = 0.0
    return Cells(site, area, spread, bow, np.full(len(middle), patch))


def first_cells(fine: FinePoints, spacing_m: float) -> I32:
    """Which box each fine point is in, (n,); boxes counted in the order of their coordinates."""
    lift_m = NORMAL_WEIGHT * spacing_m
    key, room = np.zeros(len(fine.triangle), np.int64), 1
    for k in range(6):
        column = fine.position_m[:, k] if k < 3 else lift_m * fine.normal[fine.triangle, k - 3]
        box = np.floor(column / (spacing_m if k < 3 else 0.9 * lift_m) + 0.5).astype(np.int64)
        box -= box.min()
        size = int(box.max()) + 1
        if room * size >= 2**62:
            key = np.unique(key, return_inverse=True)[1].reshape(-1)
            room = int(key.max()) + 1
        key = key * size + box
        room *= size
    return np.asarray(np.unique(key, return_inverse=True)[1].reshape(-1), np.int32)


def without_gaps(label: I32) -> I32:
    """Labels counted without those that nothing has, in the same order."""
    used = np.bincount(label) > 0
    return np.asarray((np.cumsum(used, dtype=np.int32) - 1)[label], np.int32)


def make_cells(
    surface: Surface, spacing_m: float, tick: Tick = lambda _part: None, even: bool = False
) -> Cells:
    """Cells of the whole surface, none across a crease; even: cut by area alone, whatever its triangles."""
    area_m2 = spacing_m**2 / DENSE_PER_SAMPLE
    corners = surface.mesh.vertices_m[surface.mesh.triangles]
    owner = np.arange(len(corners))
    if even:
        corners, owner = without_slim(corners, area_m2, PART_MAX * spacing_m)
    fine = fine_points(corners, area_m2)
    patch = surface.patch_of[owner[fine.triangle]]
    order = np.argsort(patch, kind="stable")
    bounds = np.flatnonzero(np.diff(patch[order])) + 1
    reflex = reflex_corners(surface)
    parts, done = [], 0
    for rows in np.split(order, bounds):
        share = len(rows) / len(order)
        parts.append(
            relax(
                fine.of(rows),
                reflex.of(int(patch[rows[0]])),
                int(patch[rows[0]]),
                spacing_m,
                part_of(tick, done / len(order), share),
                even,
            )
        )
        done += len(rows)
    return Cells(
        np.concatenate([c.position_m for c in parts]),
        np.concatenate([c.area_m2 for c in parts]),
        np.concatenate([c.spread_m2 for c in parts]),
        np.concatenate([c.bow_m for c in parts]),
        np.concatenate([c.patch for c in parts]),
    )
