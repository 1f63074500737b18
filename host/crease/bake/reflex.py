"""Reflex corners of a tool's faces: where a concave crease ends on a face, and cells that reach round such a corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from crease.bake.gather import I32
from crease.bake.surface import Surface
from crease.bake.vectors import F64, I64, nanometres

AT = 0.35
"""A cell is at a corner when it has a fine point within so many spacings of it: those are up to 0.29 long."""


@dataclass(frozen=True)
class ReflexCorners:
    """Where concave creases end on another patch, and the normals of the two facets that meet in each.

    Shapes: patch (n,), corner_m (n, 3), normal (n, 2, 3).
    """

    patch: I64
    corner_m: F64
    normal: F64

    def of(self, patch: int) -> ReflexCorners:
        """Those of one patch."""
        its = self.patch == patch
        return ReflexCorners(self.patch[its], self.corner_m[its], self.normal[its])


def reflex_corners(surface: Surface) -> ReflexCorners:
    """Of all patches. A patch that ends there without a reflex angle, as a floor between two walls, is among them."""
    vertices, triangles = surface.mesh.vertices_m, surface.mesh.triangles
    ends_m = surface.creases.ends_m[~surface.creases.convex]
    names = nanometres(np.concatenate([vertices, ends_m.reshape(-1, 3)]))
    place = np.unique(names, return_inverse=True)[1].reshape(-1)
    of_corner, of_end = place[: len(vertices)][triangles], place[len(vertices) :].reshape(-1, 2)
    beside: dict[int, list[int]] = {int(p): [] for p in np.unique(of_end)}
    for triangle in np.flatnonzero(np.isin(of_corner, of_end).any(axis=1)):
        for p in of_corner[triangle]:
            if int(p) in beside:
                beside[int(p)].append(int(triangle))
    patch, corner_m, normal = [], [], []
    for ends, ends_at_m in zip(of_end.tolist(), ends_m, strict=True):
        sides = sorted(set(beside[ends[0]]) & set(beside[ends[1]]))
        if len(sides) != 2:  # where the surface touches itself
            continue
        for p, p_m in zip(ends, ends_at_m, strict=True):
            others = np.setdiff1d(surface.patch_of[beside[p]], surface.patch_of[sides])
            patch += others.tolist()
            corner_m += [p_m] * len(others)
            normal += [surface.facet_plane[surface.facet_of[sides], :3]] * len(others)
    return ReflexCorners(
        np.array(patch, np.int64),
        np.array(corner_m).reshape(-1, 3),
        np.array(normal).reshape(-1, 2, 3),
    )


def cut_at(corners: ReflexCorners, position_m: F64, label: I32, spacing_m: float) -> I32:
    """Labels (n,) of fine points, cells that reach round a reflex corner cut by the plane of one facet there.

    Such a one has points on both sides of either, and no convex outline: it is cut where the parts are most alike.
    Shapes: position_m (n, 3).
    """
    if not len(corners.patch):
        return label
    made, count = label.copy(), int(label.max()) + 1
    order = np.argsort(label, kind="stable")
    start = np.searchsorted(label[order], np.arange(count + 1))
    near = cKDTree(position_m).query_ball_point(corners.corner_m, AT * spacing_m)
    for corner_m, normal, points in zip(corners.corner_m, corners.normal, near, strict=True):
        for own, home in sorted({(int(made[p]), int(label[p])) for p in points}):
            rows = order[start[home] : start[home + 1]]
            rows = rows[made[rows] == own]
            above = (position_m[rows] - corner_m) @ normal.T > 0.0
            if not above.any(axis=0).all() or above.all(axis=0).any():
                continue  # on one side of either, as the whole of a floor between two walls
            uneven = np.abs(above.mean(axis=0) - 0.5)
            made[rows[above[:, int(np.argmin(uneven))]]] = count
            count += 1
    return made
