"""The tool as a point shell: near-uniform samples with area vectors, creases and vertices, clusters, sphere tree."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crease.bake.layout import CLUSTER, GROUP, LANES, NEIGHBOUR, SUM
from crease.bake.pieces import PIECE_NONE, mark_pieces
from crease.bake.surface import Surface
from crease.base.errors import MeshError
from crease.base.native import ffi, lib

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

DENSE_PER_SAMPLE = 24
"""Points of the fine sampling that each shell sample stands for."""
LLOYD_STEPS = 12
"""Relaxation steps towards a centroidal Voronoi tessellation; more changes the quadrature error by under 5 %."""
NORMAL_WEIGHT = 1.5
"""How far apart, in spacings, two normals at right angles are held: keeps samples off sharp edges."""
CLUSTER_NORMAL_WEIGHT = 0.8
"""The same for clusters: less, so that crease samples join the faces beside them and spheres stay small."""
FEATURE_AREA = 1e-3
"""Area of a vertex or crease sample as a share of spacing^2: gives a lone spike a direction, shifts no sum."""
TIP_TURN = 0.35
"""A crease that turns by more than this (2 sin of half the angle; 20 degrees) has a corner there."""
FINE_SPREAD = 0.0962
"""Second moment of an equilateral triangle about its centroid, per axis, as a share of its area: sqrt(3) / 18."""
FLAT = 1e-5
"""A piece that bends by less than this share of the spacing is flat: rounding of the mesh."""
SMALL_PATCH = 8
"""Patches with fewer samples share clusters."""
BESIDE_MAX = int(lib.CR_IMG_BESIDE_MAX)
"""Records of neighbours that one cluster may have."""
UNITS_MAX = 2000
"""Parts of a tool's surface that are put together to convex pieces; each has so many samples that there are no more."""
SHARED_SHEET = -0.3
"""Samples whose normals' cosine is below this are on opposite sheets of a thin part: not neighbours."""


@dataclass(frozen=True)
class Samples:
    """Shapes: position_m, area_m2 (vectors, outward), normal (n, 3); spread_m2 (n, 3, 3); the others (n,)."""

    position_m: F64
    area_m2: F64
    normal: F64
    spread_m2: F64
    ramp_m: F64
    reach_m: F64
    bow_m: F64
    feature: npt.NDArray[np.bool_]
    crease: npt.NDArray[np.bool_]
    vertex: npt.NDArray[np.bool_]
    patch: I64


@dataclass(frozen=True)
class Shell:
    """Image records of the tool. Shapes: adjacency of cluster i is adj[adj_start[i]:adj_start[i + 1]]."""

    clusters: npt.NDArray[Any]
    sums: npt.NDArray[Any]
    groups: npt.NDArray[Any]
    adj_start: npt.NDArray[np.uint32]
    adj: npt.NDArray[Any]
    points: int
    levels: int
    spacing_m: float
    h_max_m: float
    ramp_max_m: float
    root_centre_m: F64
    root_radius_m: float
    tool_radius_m: float
    area_m2: float
    pieces: int


def _unit(v: F64) -> F64:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(np.divide(v, length, out=np.zeros_like(v), where=length > 0))


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
    lifted = np.hstack([points, scale * _unit(areas)])
    weight = np.linalg.norm(areas, axis=1)
    box = np.floor(lifted / np.array([spacing_m] * 3 + [0.9 * scale] * 3) + 0.5).astype(np.int64)
    _, label = np.unique(box, axis=0, return_inverse=True)
    label = label.reshape(-1)
    for _ in range(LLOYD_STEPS):
        sites = _means(lifted, weight, label)
        _, label = cKDTree(sites).query(lifted, workers=2)
        _, label = np.unique(label, return_inverse=True)
    count = int(label.max()) + 1
    middle = _means(points, weight, label)
    area = np.column_stack([np.bincount(label, areas[:, k], count) for k in range(3)]).astype(
        np.float64
    )
    direction = _unit(area)
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
    tilt = np.linalg.norm(np.cross(_unit(areas), normals), axis=1)
    size = np.sqrt(np.linalg.norm(areas, axis=1))
    return np.asarray(size * tilt - np.einsum("nx,nx->n", points - sites, normals))


def _second_moment(points: F64, areas: F64, middle: F64, label: I64) -> F64:
    """Mean of d d^T over each cell, d from its middle, the size of the fine pieces included. Shape (cells, 3, 3)."""
    weight = np.linalg.norm(areas, axis=1)
    d = points - middle[label]
    normal = _unit(areas)
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


def thin(points: F64, distance_m: float, taken: F64) -> I64:
    """Indices of points at least distance_m apart and from `taken`, earlier ones first."""
    cell = np.floor(points / distance_m).astype(np.int64)
    grid: dict[tuple[int, int, int], list[F64]] = {}

    def is_free(key: tuple[int, int, int], p: F64) -> bool:
        for x in range(key[0] - 1, key[0] + 2):
            for y in range(key[1] - 1, key[1] + 2):
                for z in range(key[2] - 1, key[2] + 2):
                    for q in grid.get((x, y, z), ()):
                        if float(((p - q) ** 2).sum()) < distance_m**2:
                            return False
        return True

    for p, c in zip(taken, np.floor(taken / distance_m).astype(np.int64), strict=True):
        grid.setdefault((int(c[0]), int(c[1]), int(c[2])), []).append(p)
    kept = []
    for i, (p, c) in enumerate(zip(points, cell, strict=True)):
        key = (int(c[0]), int(c[1]), int(c[2]))
        if is_free(key, p):
            grid.setdefault(key, []).append(p)
            kept.append(i)
    return np.array(kept, np.int64)


def vertex_normals(surface: Surface) -> tuple[F64, F64]:
    """Area-weighted unit normal of each vertex and the largest turn (1 - cosine) of a face away from it."""
    v, t = surface.mesh.vertices_m, surface.mesh.triangles
    face = np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]])
    total = np.zeros_like(v)
    for k in range(3):
        np.add.at(total, t[:, k], face)
    normal, turn = _unit(total), np.zeros(len(v))
    for k in range(3):
        np.maximum.at(turn, t[:, k], 1 - np.einsum("tx,tx->t", _unit(face), normal[t[:, k]]))
    return normal, turn


@dataclass(frozen=True)
class Features:
    """What sticks out of a tool besides its faces: corners, and convex creases cut into straight pieces without a gap.

    Shapes: position_m (middle of the piece), normal, half_m (vector from the middle to one end, 0 at corners) (n, 3).
    """

    position_m: F64
    normal: F64
    half_m: F64


def feature_points(surface: Surface, spacing_m: float) -> Features:
    """Corners of creases, other vertices that stick out (a fine, nearly flat surface has none), and crease pieces."""
    v = surface.mesh.vertices_m
    normal, turn = vertex_normals(surface)
    ends = surface.creases.ends_m[surface.creases.convex]
    chains, tips = crease_chains(ends)
    lengths = np.linalg.norm(
        v[surface.mesh.triangles] - v[surface.mesh.triangles[:, [1, 2, 0]]], axis=2
    )
    coarse = float(np.median(lengths)) > spacing_m
    on_crease = np.isin(_keys(v), _keys(ends.reshape(-1, 3)))
    first = np.flatnonzero(np.isin(_keys(v), _keys(tips)))
    rest = np.flatnonzero(
        ~on_crease & (coarse | (turn > 1 - np.cos(np.radians(10.0)))) & (turn > 1e-6)
    )
    rest = rest[np.argsort(-turn[rest], kind="stable")]
    rest = rest[thin(v[rest], 0.5 * spacing_m, v[first])]
    vertices = np.concatenate([first, rest])
    pieces = [cut_chain(chain, spacing_m) for chain in chains]
    middle = np.concatenate([np.zeros((0, 3)), *(m for m, _ in pieces)])
    half = np.concatenate([np.zeros((0, 3)), *(h for _, h in pieces)])
    line_normal = _unit(_outward(surface, middle, 1e-4 * spacing_m)) if len(middle) else middle
    return Features(
        np.concatenate([v[vertices], middle]),
        np.concatenate([normal[vertices], line_normal]),
        np.concatenate([np.zeros((len(vertices), 3)), half]),
    )


def cut_chain(chain: F64, spacing_m: float) -> tuple[F64, F64]:
    """A polyline (n, 3) cut into equal pieces of at most spacing_m: middles and half vectors of their chords."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    count = max(1, int(np.ceil(along[-1] / spacing_m - 1e-9)))
    at = np.linspace(0.0, along[-1], count + 1)
    points = np.column_stack([np.interp(at, along, chain[:, k]) for k in range(3)])
    return 0.5 * (points[:-1] + points[1:]), 0.5 * (points[1:] - points[:-1])


def crease_chains(ends: F64) -> tuple[list[F64], F64]:
    """Creases (n, 2, 3) joined into polylines that run straight on, and their tips: where they turn, branch or end."""
    if len(ends) == 0:
        return [], np.zeros((0, 3))
    keys, index, inverse = np.unique(
        _keys(ends.reshape(-1, 3)), return_index=True, return_inverse=True
    )
    node = inverse.reshape(-1, 2)
    points = ends.reshape(-1, 3)[index]
    along = _unit(ends[:, 1] - ends[:, 0])
    total = np.zeros((len(keys), 3))
    np.add.at(total, node[:, 0], along)
    np.add.at(total, node[:, 1], -along)
    degree = np.bincount(node.reshape(-1), minlength=len(keys))
    is_tip = (degree != 2) | (np.linalg.norm(total, axis=1) > TIP_TURN)
    beside: list[list[int]] = [[] for _ in keys]
    for edge, (a, b) in enumerate(node):
        beside[a].append(edge)
        beside[b].append(edge)
    free = np.ones(len(ends), bool)

    def walk(start: int, edge: int) -> F64:
        path, at = [start], start
        while True:
            free[edge] = False
            at = int(node[edge].sum() - at)
            path.append(at)
            onward = [e for e in beside[at] if free[e]]
            if is_tip[at] or not onward:
                return np.asarray(points[path])
            edge = onward[0]

    starts = [*np.flatnonzero(is_tip), *np.flatnonzero(~is_tip)]
    chains = [walk(int(n), e) for n in starts for e in beside[n] if free[e]]
    return chains, points[is_tip]


def _keys(points: F64) -> npt.NDArray[Any]:
    """One comparable value per point, to a nanometre."""
    whole = np.ascontiguousarray(np.round(points * 1e9).astype(np.int64))
    return whole.view([("", np.int64)] * 3).reshape(-1)


def _outward(surface: Surface, points: F64, step_m: float) -> F64:
    """Gradient of the distance at points on the surface, by central differences."""
    axes = np.eye(3) * step_m
    grad = np.empty_like(points)
    for k in range(3):
        high, _ = surface.signed_distance(points + axes[k])
        low, _ = surface.signed_distance(points - axes[k])
        grad[:, k] = high - low
    return grad


def make_samples(surface: Surface, spacing_m: float) -> Samples:
    """The shell before grouping."""
    cells = make_cells(surface, spacing_m)
    position, count = cells.position_m, len(cells.position_m)
    spots = feature_points(surface, spacing_m)
    spot_area = FEATURE_AREA * spacing_m**2 * spots.normal
    some = len(spots.position_m) > 0
    spot_patch = (
        cells.patch[cKDTree(position).query(spots.position_m)[1]] if some else np.zeros(0, np.int64)
    )
    # The closed surface's area vectors add up to zero; the features' little areas must not spoil that.
    area = cells.area_m2 - (cells.area_m2.sum(axis=0) + spot_area.sum(axis=0)) / count
    spread = np.concatenate(
        [cells.spread_m2, spots.half_m[:, :, None] * spots.half_m[:, None, :] / 3]
    )
    # A uniform strip of width b has the second moment b^2 / 12.
    widest = np.sqrt(np.maximum(0.0, 12 * np.linalg.eigvalsh(spread)[:, -1]))
    half = np.linalg.norm(spots.half_m, axis=1)
    return Samples(
        np.concatenate([position, spots.position_m]),
        np.concatenate([area, spot_area]),
        np.concatenate([_unit(area), spots.normal]),
        spread,
        0.5 * np.maximum(widest, 0.1 * spacing_m),
        np.concatenate([np.zeros(count), half]),
        np.concatenate([cells.bow_m, np.zeros(len(half))]),
        np.arange(count + len(spot_area)) >= count,
        np.concatenate([np.zeros(count, bool), half > 0]),
        np.concatenate([np.zeros(count, bool), half == 0]),
        np.concatenate([cells.patch, spot_patch]),
    )


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


def _up(values: F64 | float) -> Any:
    """Rounded up to single precision with room for the rounding of positions."""
    return np.float32(np.asarray(values) * (1 + 1e-6) + 1e-9)


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
        row["ramp"] = _up(samples.ramp_m[lanes])
        row["reach"] = samples.reach_m[lanes] * real
        row["bow"] = np.where(samples.bow_m[lanes] > 0, _up(samples.bow_m[lanes]), 0)
        row["count"] = len(ids)
        row["crease_mask"] = int((samples.crease[lanes] & real) @ (1 << np.arange(LANES)))
        row["vertex_mask"] = int((samples.vertex[lanes] & real) @ (1 << np.arange(LANES)))
        normal = samples.area_m2[ids].sum(axis=0)
        row["normal"] = _unit(normal)
        mean = samples.position_m[ids].mean(axis=0)
        row["radius_m"] = _up(np.linalg.norm(samples.position_m[ids] - mean, axis=1).max())
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


@dataclass(frozen=True)
class _Level:
    centre: F64
    radius: F64
    margin: F64
    rho: F64
    first: I64


def _cluster_level(clusters: npt.NDArray[Any]) -> _Level:
    points = np.stack([clusters[axis] for axis in "xyz"], axis=2).astype(np.float64)
    balls = [ball(p, np.zeros(LANES)) for p in points]
    margin = clusters["ramp"].astype(np.float64).max(axis=1)
    return _Level(
        np.array([b[0] for b in balls]),
        np.array([b[1] for b in balls]),
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
        balls = [ball(level.centre[p], level.radius[p]) for p in parts]
        level = _Level(
            np.array([b[0] for b in balls]),
            np.array([b[1] for b in balls]),
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
    row["radius"] = _up(below.radius[lanes])
    row["margin"] = _up(below.margin[lanes])
    row["rho"] = _up(below.rho[lanes])
    row["child"] = child_base + lanes
    row["first"] = below.first[lanes]
    row["count"] = len(part)


def neighbours(samples: Samples, spacing_m: float) -> I64:
    """Pairs of samples beside each other on the tool surface, (n, 2)."""
    pairs = cKDTree(samples.position_m).query_pairs(1.6 * spacing_m, output_type="ndarray")
    if len(pairs):
        cosine = np.einsum("nx,nx->n", samples.normal[pairs[:, 0]], samples.normal[pairs[:, 1]])
        pairs = pairs[(cosine > SHARED_SHEET) | samples.feature[pairs].any(axis=1)]
    return np.asarray(pairs, dtype=np.int64)


def make_adjacency(
    clusters: npt.NDArray[Any], groups: list[I64], pairs: I64
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[Any]]:
    """Which samples are beside each other: within a cluster into clusters["beside"], across clusters as start offsets
    and records, one for each sample and each cluster beside it.

    Errors: MeshError when a cluster has more than BESIDE_MAX records, which a tick could not work off in its time.
    """
    count = sum(len(ids) for ids in groups)
    cluster_of, lane_of = np.empty(count, np.int64), np.empty(count, np.int64)
    for i, ids in enumerate(groups):
        cluster_of[ids] = i
        lane_of[ids] = np.arange(len(ids))
    both = np.concatenate([pairs, pairs[:, ::-1]])
    bit = (1 << lane_of[both]).astype(np.uint16)
    home = cluster_of[both]
    within = home[:, 0] == home[:, 1]
    own = (home[within, 0], lane_of[both[within, 0]])
    np.bitwise_or.at(clusters["beside"], own, bit[within, 1])
    home, bit = home[~within], bit[~within]
    keys = np.column_stack([home, bit[:, 0]])
    links, where = np.unique(keys, axis=0, return_inverse=True)
    out = np.zeros(len(links), NEIGHBOUR)
    out["cluster"], out["mine"] = links[:, 1], links[:, 2]
    np.bitwise_or.at(out["theirs"], where.reshape(-1), bit[:, 1])
    start = np.searchsorted(links[:, 0], np.arange(len(groups) + 1)).astype(np.uint32)
    most = int(np.diff(start).max())
    if most > BESIDE_MAX:
        raise MeshError(
            f"{most} neighbours of one cluster of samples, at most {BESIDE_MAX}: the tool has creases much closer "
            "together than its samples; give a smaller --spacing, or a tool without that detail"
        )
    return start, out


def pieces_of_lanes(pieces: I64) -> tuple[I64, I64]:
    """The two pieces that most samples of a cluster belong to, PIECE_NONE for no second, and the lanes of each.

    A sample of neither counts in the first. Shapes: pieces (n, 2); results (2,).
    """
    names, counts = np.unique(pieces[pieces != PIECE_NONE], return_counts=True)
    found = np.asarray([*names[np.lexsort((names, -counts))], PIECE_NONE][:2], np.int64)
    bits = 1 << np.arange(len(pieces))
    lanes = [int(bits[(pieces == piece).any(axis=1)].sum()) if piece != PIECE_NONE else 0 for piece in found]
    lanes[0] |= int(bits.sum()) & ~lanes[1]
    return found, np.asarray(lanes, np.int64)


def pieces_of(samples: Samples, spacing_m: float, surface: Surface) -> I64:
    """The two largest convex pieces of each sample, (n, 2); a feature has those of the nearest face sample."""
    face = np.flatnonzero(~samples.feature)
    faces = Samples(*(getattr(samples, f.name)[face] for f in fields(Samples)))
    order = cluster_order(faces, spacing_m, most=max(LANES, -(-len(face) // UNITS_MAX)))
    normal = np.array([_unit(faces.area_m2[ids].sum(axis=0)) for ids in order])
    of_cluster = mark_pieces(normal, faces.position_m, order, spacing_m, surface)
    of_face = np.empty((len(face), 2), np.int64)
    for ids, piece in zip(order, of_cluster, strict=True):
        of_face[ids] = piece
    nearest = cKDTree(faces.position_m).query(samples.position_m)[1]
    return np.asarray(of_face[nearest])


def make_shell(surface: Surface, spacing_m: float) -> Shell:
    """The complete shell of a tool mesh."""
    samples = make_samples(surface, spacing_m)
    order = cluster_order(samples, spacing_m)
    clusters = make_clusters(samples, order)
    pieces = pieces_of(samples, spacing_m, surface)
    for row, ids in zip(clusters, order, strict=True):
        row["piece"], row["piece_lanes"] = pieces_of_lanes(pieces[ids])
    groups, levels = make_tree(clusters)
    start, adj = make_adjacency(clusters, order, neighbours(samples, spacing_m))
    root, radius = ball(samples.position_m, np.zeros(len(samples.position_m)))
    return Shell(
        clusters,
        make_sums(clusters),
        groups,
        start,
        adj,
        len(samples.position_m),
        levels,
        spacing_m,
        float(2 * samples.ramp_m.max()),
        float(samples.ramp_m.max()),
        root,
        float(_up(radius)),
        float(_up(np.linalg.norm(samples.position_m, axis=1).max())),
        float(np.linalg.norm(samples.area_m2[~samples.feature], axis=1).sum()),
        int(pieces[pieces < PIECE_NONE].max()) + 1,
    )
