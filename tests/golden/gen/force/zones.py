"""Candidate "zones with relations": one half-space per pair (static patch, tool patch), see README.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from bodies import Body, Floats, Ints, Samples
from numpy.typing import NDArray
from scipy.optimize import nnls

AXES = np.vstack([np.eye(3), -np.eye(3)])
# A sample counts wholly for the depth of a zone that holds this share of it (one of three always does).
WHOLE_SHARE = 1.0 / 3.0
# Sine of the angle over which curved zones pass from together to apart.
APART_SINE = 0.25


@dataclass
class Contact:
    """n.t >= depth frees the tool; moment of its distribution about the tool origin per unit of force (mm)."""

    normal: Floats
    depth: float
    moment: Floats


@dataclass
class Options:
    power: int = 1
    split_tool: bool = True
    relations: bool = True
    clique: bool = False


@dataclass
class _Members:
    """A sample in a static patch (n,): sample, patch, height below it, outward normal there, foot."""

    sample: Ints
    patch: Ints
    height: Floats
    away: Floats
    foot: Floats


def _members(static: Body, points: Floats) -> _Members:
    dist, face, foot, feature = static.closest(points)
    inside = np.flatnonzero(dist < 0.0)
    face, foot, feature, depth = face[inside], foot[inside], feature[inside], -dist[inside]
    away = (foot - points[inside]) / np.maximum(depth[:, None], 1e-300)
    away = np.where(depth[:, None] > 1e-9, away, static.normals[face])
    k = np.clip(feature - 1, 0, 2)
    other = static.patch[static.beside[face, k]]
    split = (feature >= 1) & (feature <= 3) & (other != static.patch[face])
    tip = feature >= 4
    corner = static.faces[face, np.clip(feature - 4, 0, 2)]
    shared = np.array([len(static.corner_patches[c]) > 1 for c in corner], dtype=bool) & tip
    plain = ~(split | shared)
    rows = [(inside[plain], static.patch[face[plain]], depth[plain], away[plain], foot[plain])]
    for i in np.flatnonzero(split | shared):
        if split[i]:
            walls = [static.normals[face[i]], static.normals[static.beside[face[i], k[i]]]]
            labels = [static.patch[face[i]], other[i]]
        else:
            at = static.corner_patches[corner[i]]
            labels = list(at)
            walls = [v / np.linalg.norm(v) for v in at.values()]
        for label, wall in zip(labels, walls, strict=True):
            h = float((foot[i] - points[inside[i]]) @ wall)
            if h > 0.0:
                rows.append(([inside[i]], [label], [h], wall[None], foot[i][None]))
    return _Members(*(np.concatenate([np.asarray(r[j]) for r in rows]) for j in range(5)))


def _relation(normal: Floats, point: Floats) -> Floats:
    """(z, z): 1 where each zone lies below the other's tangent plane, falling to 0 above it."""
    gap = point[None] - point[:, None]
    over = np.einsum("ik,ijk->ij", normal, gap)
    sine = np.maximum(over, over.T) / np.maximum(np.linalg.norm(gap, axis=2), 1e-9)
    rel = np.clip(1.0 - sine / APART_SINE, 0.0, 1.0)
    np.fill_diagonal(rel, 1.0)
    return rel


def _table(table: Floats, patch: Ints, normal: Floats, point: Floats) -> Floats:
    """Relation by label where both patches are planes, else by geometry."""
    known = table[patch[:, None], patch[None]]
    return np.where(np.isnan(known), _relation(normal, point), known)


def exits(static: Body, x: Floats, n: Floats, tangent: Floats, planes: NDArray[np.int64], curved: NDArray[np.bool_],
          patch: Ints) -> Floats:
    """Way of the points x along n out of the static planes given and out of the tangent plane of each."""
    way = tangent.copy()
    for c in planes:
        rate = static.patch_normal[c] @ n
        if rate > 1e-9:
            h = (static.patch_point[c] - x) @ static.patch_normal[c]
            way = np.minimum(way, np.where(h > -1e-6, np.maximum(h, 0.0) / rate, np.inf))
    go = np.flatnonzero(curved & np.isfinite(way))
    go = go[np.argsort(-way[go])[:24]]
    if len(go):
        way[go] = _march(static, x[go], n, way[go], patch[go])
    return way


def _march(static: Body, x: Floats, n: Floats, first: Floats, patch: Ints) -> Floats:
    """First exit along n from points below a curved patch: steps of the distance, at most 30."""
    t = np.zeros(len(x))
    live = np.ones(len(x), dtype=bool)
    for _ in range(8):
        d, face, foot, _ = static.closest(x[live] + t[live, None] * n)
        at = np.flatnonzero(live)
        same = static.patch[face] == patch[at]
        g = (foot - x[at] - t[at, None] * n) / np.maximum(-d, 1e-12)[:, None]
        rate = np.where((d < 0) & same, np.maximum(g @ n, 0.2), 1.0)
        step = np.where(d < 0, np.where(same, -d / rate, np.maximum(first[at] - t[at], 0.0)), 0.0)
        # A tangent step may leave a convex patch too far: halve until inside is not needed, as depth is a bound.
        safe = np.minimum(step, np.where(same, np.inf, step))
        t[at] += safe
        live[at] = (d < -1e-4) & same & (step > 1e-5)
        if not live.any():
            break
    return np.minimum(t, np.where(np.isfinite(first), np.maximum(first, t), t))


def contacts(static: Body, tool: Samples, turn: Floats, position: Floats, opt: Options) -> list[Contact]:
    """Half-spaces of one pose."""
    points = tool.points @ turn.T + position
    lo, hi = static.vertices.min(0), static.vertices.max(0)
    near = np.flatnonzero(((points > lo) & (points < hi)).all(1))
    if not len(near):
        return []
    m = _members(static, points[near])
    if not len(m.sample):
        return []
    s = near[m.sample]
    curved = ~static.flat[m.patch]
    share = np.where(curved[:, None], np.maximum(m.away @ AXES.T, 0.0) ** 2, np.eye(6)[0])
    index = np.broadcast_to((m.patch * 6)[:, None] + np.arange(6), share.shape)
    tool_patch = tool.patch[s] if opt.split_tool else np.zeros(len(s), np.int64)
    key = index + tool_patch[:, None] * (6 * len(static.flat))
    row, col = np.nonzero(share > 0.0)
    w, key = share[row, col], key[row, col]
    zones, z = np.unique(key, return_inverse=True)
    zb, za = (zones % (6 * len(static.flat))) // 6, zones // (6 * len(static.flat))
    count = len(zones)

    def total(v: Floats) -> Floats:
        out = np.zeros((count, *v.shape[1:]))
        np.add.at(out, z, v)
        return out

    area = tool.areas[s] @ turn.T
    push = -(w * m.height[row] ** opt.power)[:, None] * area[row]
    sums = total(push)
    moments = total(np.cross(points[s[row]] - position, push))
    mass = w * m.height[row] ** opt.power * np.linalg.norm(area[row], axis=1) + 1e-12 * w
    weight = np.maximum(total(mass[:, None]), 1e-300)
    zone_n = total(mass[:, None] * m.away[row])
    zone_n /= np.maximum(np.linalg.norm(zone_n, axis=1, keepdims=True), 1e-300)
    zone_p = total(mass[:, None] * m.foot[row]) / weight
    tool_n = total(mass[:, None] * (tool.normals[s[row]] @ turn.T))
    tool_n /= np.maximum(np.linalg.norm(tool_n, axis=1, keepdims=True), 1e-300)
    tool_p = total(mass[:, None] * points[s[row]]) / weight
    rel = np.ones((count, count))
    if opt.relations:
        rel = _table(static.convexity, zb, zone_n, zone_p)
        if opt.split_tool:
            rel = rel * _table(tool_table(tool), za, tool_n, tool_p)
    found = []
    for i in range(count):
        k = rel[i]
        lead = 1.0
        if opt.clique:
            mass_k = k * np.linalg.norm(sums, axis=1)
            lead = min(1.0, max(0.0, float(mass_k @ rel @ mass_k / max(mass_k.sum() ** 2, 1e-300)) * 5.0 - 4.0))
            if lead == 0.0:
                continue
        use = k > 0.0
        base = zone_n[use]
        coef, _ = nnls(base.T, k @ sums)
        n = coef @ base
        size = np.linalg.norm(n)
        if size < 1e-12:
            continue
        n = n / size
        mine = z == i
        r = row[mine]
        x, g = points[s[r]], m.away[r]
        rate = g @ n
        tangent = np.where(rate > 1e-9, m.height[r] / np.maximum(rate, 1e-9), np.inf)
        b = int(zb[i])
        if static.flat[b]:
            planes = np.flatnonzero((static.convexity[b] == 1.0) if opt.relations else static.flat)
        else:
            planes = np.zeros(0, np.int64)
        way = exits(static, x, n, tangent, planes, curved[r], m.patch[r])
        way = np.where(np.isfinite(way), way, 0.0) * np.minimum(1.0, w[mine] / WHOLE_SHARE)
        depth = lead * float(way.max())
        if depth > 0.0:
            found.append(Contact(n, depth, k @ moments / size))
    return found


def tool_table(tool: Samples) -> Floats:
    return tool.convexity  # type: ignore[attr-defined]
