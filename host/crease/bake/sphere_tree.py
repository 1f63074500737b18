"""Spheres round clusters, and spheres round those: what detection skips by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import GROUP, LANES
from crease.bake.vectors import F64, I64, rounded_up

BLOCK = 2048
"""Sets of points that are worked on at once: they stay in the processor's cache."""


def ball(points: F64, extra: F64) -> tuple[F64, float]:
    """A small sphere round spheres of radius extra at points: centre and radius. Badoiu, Clarkson 2003."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for step in range(1, 40):
        reach = np.linalg.norm(points - centre, axis=1) + extra
        far = int(np.argmax(reach))
        centre = centre + (points[far] - centre) / (step + 1)
    centre = centre.astype(np.float32).astype(np.float64)
    reach = np.linalg.norm(points - centre, axis=1) + extra
    return centre, float(reach.max())


def balls(points: F64, extra: F64) -> tuple[F64, F64]:
    """The same for many sets of as many points each, to the bit. Shapes: points (n, k, 3), extra (n, k)."""
    middle, radius = np.empty((len(points), 3)), np.empty(len(points))
    for first in range(0, len(points), BLOCK):
        part, more = points[first : first + BLOCK], extra[first : first + BLOCK]
        rows = np.arange(len(part))
        centre = 0.5 * (part.min(axis=1) + part.max(axis=1))
        for step in range(1, 40):
            far = np.argmax(np.linalg.norm(part - centre[:, None], axis=2) + more, axis=1)
            centre = centre + (part[rows, far] - centre) / (step + 1)
        centre = centre.astype(np.float32).astype(np.float64)
        reach = np.linalg.norm(part - centre[:, None], axis=2) + more
        middle[first : first + BLOCK], radius[first : first + BLOCK] = centre, reach.max(axis=1)
    return middle, radius


@dataclass(frozen=True)
class _Level:
    centre: F64
    radius: F64
    margin: F64
    rho: F64
    first: I64


def _cluster_level(clusters: npt.NDArray[Any]) -> _Level:
    points = np.stack([clusters[axis] for axis in "xyz"], axis=2).astype(np.float64)
    centre, radius = balls(points, np.zeros(points.shape[:2]))
    margin = clusters["ramp"].astype(np.float64).max(axis=1)
    return _Level(
        centre,
        radius,
        margin,
        np.linalg.norm(points, axis=2).max(axis=1),
        np.arange(len(clusters)),
    )


def make_tree(clusters: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], int]:
    """Groups of 16 spheres, root first, each level after its parents; and the number of levels."""
    level = _cluster_level(clusters)
    levels: list[tuple[_Level, list[I64]]] = []
    while True:
        count = len(level.radius)
        parts = [np.arange(i, min(i + LANES, count)) for i in range(0, count, LANES)]
        levels.append((level, parts))
        if len(parts) == 1:
            break
        full = count // LANES * LANES
        centre, radius = balls(
            level.centre[:full].reshape(-1, LANES, 3), level.radius[:full].reshape(-1, LANES)
        )
        if full < count:
            last, reach = ball(level.centre[full:], level.radius[full:])
            centre, radius = np.vstack([centre, last]), np.append(radius, reach)
        level = _Level(
            centre,
            radius,
            np.array([level.margin[p].max() for p in parts]),
            np.array([level.rho[p].max() for p in parts]),
            np.array([level.first[p[0]] for p in parts]),
        )
    levels.reverse()
    starts = np.cumsum([0, *(len(parts) for _, parts in levels)])
    groups = np.zeros(starts[-1], GROUP)
    for depth, (below, parts) in enumerate(levels):
        leaf = depth == len(levels) - 1
        for i, part in enumerate(parts):
            _fill_group(
                groups[starts[depth] + i], below, part, 0 if leaf else int(starts[depth + 1])
            )
            groups[starts[depth] + i]["leaf"] = leaf
            groups[starts[depth] + i]["level"] = depth
    return groups, len(levels)


def _fill_group(row: Any, below: _Level, part: I64, child_base: int) -> None:
    lanes = np.concatenate([part, np.full(LANES - len(part), part[0])])
    for k, axis in enumerate("xyz"):
        row[axis] = below.centre[lanes, k]
    row["radius"] = rounded_up(below.radius[lanes])
    row["margin"] = rounded_up(below.margin[lanes])
    row["rho"] = rounded_up(below.rho[lanes])
    row["child"] = child_base + lanes
    row["first"] = below.first[lanes]
    row["count"] = len(part)
