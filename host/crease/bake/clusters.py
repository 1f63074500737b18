"""Samples in clusters, as the records of an image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import CLUSTER, LANES, SUM
from crease.bake.samples import Samples
from crease.bake.vectors import F64, I64, rounded_up, unit
from crease.base.native import ffi, lib

CLUSTER_NORMAL_WEIGHT = 0.8
"""The same for clusters: less, so that crease samples join the faces beside them and spheres stay small."""
SMALL_PATCH = 8
"""Patches with fewer samples share clusters."""


def halve(points: F64, ids: I64, most: int) -> list[I64]:
    """ids in groups of at most `most`, by halving the box of their points; all but the last few groups are full."""
    groups: list[I64] = []
    stack = [ids]
    while stack:
        part = stack.pop()
        if len(part) <= most:
            groups.append(part)
            continue
        full = -(-len(part) // most)
        left = min(len(part) - 1, most * ((full + 1) // 2))
        axis = int(np.argmax(np.ptp(points[part], axis=0)))
        part = part[np.argsort(points[part, axis], kind="stable")]
        stack.append(part[left:])
        stack.append(part[:left])
    return groups


def cluster_order(samples: Samples, spacing_m: float, most: int = LANES) -> list[I64]:
    """Samples in clusters of at most `most`, each on one patch (tiny patches share), neighbours near in the list."""
    lifted = np.hstack([samples.position_m, CLUSTER_NORMAL_WEIGHT * spacing_m * samples.normal])
    size = np.bincount(samples.patch)[samples.patch]
    home = np.where(size >= SMALL_PATCH, samples.patch, -1)
    order = np.argsort(home, kind="stable")
    bounds = np.flatnonzero(np.diff(home[order])) + 1
    clusters = [group for part in np.split(order, bounds) for group in halve(lifted, part, most)]
    centre = np.array([samples.position_m[ids].mean(axis=0) for ids in clusters])
    return [clusters[i] for part in halve(centre, np.arange(len(clusters)), LANES) for i in part]


SPREAD_FIELDS = {
    "wxx": (0, 0),
    "wyy": (1, 1),
    "wzz": (2, 2),
    "wxy": (0, 1),
    "wyz": (1, 2),
    "wzx": (2, 0),
}


def make_clusters(samples: Samples, groups: list[I64]) -> npt.NDArray[Any]:
    """SoA records; unused lanes repeat the first point without area."""
    out = np.zeros(len(groups), CLUSTER)
    for row, ids in zip(out, groups, strict=True):
        lanes = np.concatenate([ids, np.full(LANES - len(ids), ids[0])])
        real = np.arange(LANES) < len(ids)
        for k, axis in enumerate("xyz"):
            row[axis] = samples.position_m[lanes, k]
            row["a" + axis] = samples.area_m2[lanes, k] * real
        row["area"] = np.linalg.norm(samples.area_m2[lanes], axis=1) * real
        for name, (i, j) in SPREAD_FIELDS.items():
            row[name] = 12 * samples.spread_m2[lanes, i, j]
        row["ramp"] = rounded_up(samples.ramp_m[lanes])
        row["reach"] = samples.reach_m[lanes] * real
        row["bow"] = np.where(samples.bow_m[lanes] > 0, rounded_up(samples.bow_m[lanes]), 0)
        row["count"] = len(ids)
        row["crease_mask"] = int((samples.crease[lanes] & real) @ (1 << np.arange(LANES)))
        row["vertex_mask"] = int((samples.vertex[lanes] & real) @ (1 << np.arange(LANES)))
        normal = samples.area_m2[ids].sum(axis=0)
        row["normal"] = unit(normal)
        mean = samples.position_m[ids].mean(axis=0)
        row["radius_m"] = rounded_up(np.linalg.norm(samples.position_m[ids] - mean, axis=1).max())
    return out


def make_sums(clusters: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Full-coverage sums, by the firmware's own addition."""
    sums = np.zeros(len(clusters), SUM)
    for i in range(len(clusters)):
        lib.crp_sum_cluster(
            ffi.from_buffer("struct cr_img_cluster *", clusters[i : i + 1]),
            ffi.from_buffer("struct cr_img_sum *", sums[i : i + 1]),
        )
    return sums
