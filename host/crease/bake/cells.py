"""The faces of a tool as near-uniform pieces: positions, area vectors that add up, second moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from crease.bake.surface import THREADS, Surface
from crease.bake.vectors import F64, I64, unit

DENSE_PER_SAMPLE = 24
"""Points of the fine sampling that each shell sample stands for."""
LLOYD_STEPS = 12
"""Relaxation steps towards a centroidal Voronoi tessellation; more changes the quadrature error by under 5 %."""
NORMAL_WEIGHT = 1.5
"""How far apart, in spacings, two normals at right angles are held: keeps samples off sharp edges."""
FINE_SPREAD = 0.0962
"""Second moment of an equilateral triangle about its centroid, per axis, as a share of its area: sqrt(3) / 18."""
FLAT = 1e-5
"""A piece that bends by less than this share of the spacing is flat: rounding of the mesh."""


def fine_points(surface: Surface, area_m2: float) -> tuple[F64, F64, I64]:
    """Every triangle cut into k^2 equal parts of at most area_m2: centroids, area vectors (n, 3), triangles (n,)."""
    corners = surface.mesh.vertices_m[surface.mesh.triangles]
    normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    parts = np.ceil(np.sqrt(np.linalg.norm(normal, axis=1) / area_m2)).astype(np.int64)
    points, areas, owner = [], [], []
    for k in np.unique(parts[parts > 0]):
        chosen = corners[parts == k]
        weights = _part_weights(int(k))
        points.append(np.einsum("wc,tcx->twx", weights, chosen).reshape(-1, 3))
        areas.append(np.repeat(normal[parts == k] / k**2, k**2, axis=0))
        owner.append(np.repeat(np.flatnonzero(parts == k), k**2))
    return np.concatenate(points), np.concatenate(areas), np.concatenate(owner)


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


def relax(points: F64, areas: F64, patch: int, spacing_m: float) -> Cells:
    """Fine points of one patch gathered into cells: positions on the surface, area vectors that add up, and the
    second moment of each cell about its middle.

    A centroidal Voronoi tessellation in the space of position and weighted normal.
    """
    scale = NORMAL_WEIGHT * spacing_m
    lifted = np.hstack([points, scale * unit(areas)])
    weight = np.linalg.norm(areas, axis=1)
    box = np.floor(lifted / np.array([spacing_m] * 3 + [0.9 * scale] * 3) + 0.5).astype(np.int64)
    _, label = np.unique(box, axis=0, return_inverse=True)
    label = label.reshape(-1)
    for _ in range(LLOYD_STEPS):
        sites = _means(lifted, weight, label)
        _, label = cKDTree(sites).query(lifted, workers=THREADS)
        _, label = np.unique(label, return_inverse=True)
    count = int(label.max()) + 1
    middle = _means(points, weight, label)
    area = np.column_stack([np.bincount(label, areas[:, k], count) for k in range(3)]).astype(
        np.float64
    )
    direction = unit(area)
    near = cKDTree(points).query(middle)[1]
    lift = np.einsum("nx,nx->n", points[near] - middle, direction)
    spread = _second_moment(points, areas, middle, label)
    site = middle + lift[:, None] * direction
    bow = np.zeros(count)
    np.maximum.at(bow, label, _behind(points, areas, site[label], direction[label]))
    bow[bow < FLAT * spacing_m] = 0.0
    return Cells(site, area, spread, bow, np.full(count, patch))


def _behind(points: F64, areas: F64, sites: F64, normals: F64) -> F64:
    """How far the fine pieces reach behind planes through sites, row by row, (n,)."""
    tilt = np.linalg.norm(np.cross(unit(areas), normals), axis=1)
    size = np.sqrt(np.linalg.norm(areas, axis=1))
    return np.asarray(size * tilt - np.einsum("nx,nx->n", points - sites, normals))


def _second_moment(points: F64, areas: F64, middle: F64, label: I64) -> F64:
    """Mean of d d^T over each cell, d from its middle, the size of the fine pieces included. Shape (cells, 3, 3)."""
    weight = np.linalg.norm(areas, axis=1)
    d = points - middle[label]
    normal = unit(areas)
    own = (
        FINE_SPREAD * weight[:, None, None] * (np.eye(3) - normal[:, :, None] * normal[:, None, :])
    )
    moment = (d[:, :, None] * d[:, None, :] + own).reshape(-1, 9)
    return _means(moment, weight, label).reshape(-1, 3, 3)


def make_cells(surface: Surface, spacing_m: float) -> Cells:
    """Cells of the whole surface, none across a crease."""
    points, areas, owner = fine_points(surface, spacing_m**2 / DENSE_PER_SAMPLE)
    patch = surface.patch_of[owner]
    order = np.argsort(patch, kind="stable")
    bounds = np.flatnonzero(np.diff(patch[order])) + 1
    parts = [
        relax(points[rows], areas[rows], int(patch[rows[0]]), spacing_m)
        for rows in np.split(order, bounds)
    ]
    return Cells(
        np.concatenate([c.position_m for c in parts]),
        np.concatenate([c.area_m2 for c in parts]),
        np.concatenate([c.spread_m2 for c in parts]),
        np.concatenate([c.bow_m for c in parts]),
        np.concatenate([c.patch for c in parts]),
    )


def _means(values: F64, weight: F64, label: I64) -> F64:
    total = np.bincount(label, weight)
    columns = [np.bincount(label, weight * values[:, k]) for k in range(values.shape[1])]
    return np.column_stack(columns) / np.maximum(total, 1e-300)[:, None]
