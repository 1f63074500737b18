"""Samples in clusters, as the records of an image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import CLUSTER, LANES, SUM
from crease.bake.samples import Samples
from crease.bake.vectors import F64, I64, rounded_up, unit, without_dust
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
    count = np.array([len(ids) for ids in groups])
    lane = np.arange(LANES)
    real = lane < count[:, None]
    first = np.cumsum(count) - count
    lanes = np.concatenate(groups)[first[:, None] + np.where(real, lane, 0)]
    out = np.zeros(len(groups), CLUSTER)
    position, area = samples.position_m[lanes], samples.area_m2[lanes]
    size = np.linalg.norm(area, axis=2)
    area = without_dust(area, size[:, :, None])
    spread = 12 * samples.spread_m2[lanes]
    spread = without_dust(spread, np.abs(spread).max(axis=(2, 3), keepdims=True))
    for k, axis in enumerate("xyz"):
        out[axis] = position[:, :, k]
        out["a" + axis] = area[:, :, k] * real
    out["area"] = size * real
    for name, (i, j) in SPREAD_FIELDS.items():
        out[name] = spread[:, :, i, j]
    out["ramp"] = rounded_up(samples.ramp_m[lanes])
    out["reach"] = samples.reach_m[lanes] * real
    out["bow"] = np.where(samples.bow_m[lanes] > 0, rounded_up(samples.bow_m[lanes]), 0)
    out["count"] = count
    out["crease_mask"] = (samples.crease[lanes] & real) @ (1 << lane)
    out["vertex_mask"] = (samples.vertex[lanes] & real) @ (1 << lane)
    out["inner_mask"] = (samples.inner[lanes] & real) @ (1 << lane)
    out["normal"] = unit((area * real[:, :, None]).sum(axis=1))
    mean = (position * real[:, :, None]).sum(axis=1) / count[:, None]
    out["radius_m"] = rounded_up(np.linalg.norm(position - mean[:, None], axis=2).max(axis=1))
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
