"""The tool as a point shell: samples in clusters, who is beside whom, convex pieces, sphere tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from crease.bake.clusters import cluster_order, make_clusters, make_sums
from crease.bake.layout import LANES, NEIGHBOUR
from crease.bake.pieces import PIECE_NONE, mark_pieces
from crease.bake.samples import Samples, make_samples
from crease.bake.sphere_tree import ball, make_tree
from crease.bake.surface import Surface
from crease.bake.vectors import F64, I64, rounded_up, unit
from crease.base.errors import MeshError
from crease.base.native import lib
from crease.base.progress import part_of
from crease.base.settings import setting

BESIDE_MAX = int(lib.CR_IMG_BESIDE_MAX)
"""Records of neighbours that one cluster may have."""
UNITS_MAX = 2000
"""Parts of a tool's surface that are put together to convex pieces; each has so many samples that few are more."""
NOTCH = 3.0
"""Parts of a cluster so many spacings from each other are on two sides of a notch. Rows of samples on slim strips are
up to 2.5 apart: with 2 a cylinder of 96 strips is fifteen pieces. With none parted, or only those with air between,
a spanner is kicked by 0.53 mm instead of 0.31."""
SHARED_SHEET = -0.3
"""Samples whose normals' cosine is below this are on opposite sheets of a thin part: not neighbours."""
SAMPLES_SHARE = 0.7
"""Part of the time of a large shell that its samples take, before they are grouped."""


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
    keys = (home[:, 0] * len(groups) + home[:, 1]) << 16 | bit[:, 0].astype(np.int64)
    links, where = np.unique(keys, return_inverse=True)
    out = np.zeros(len(links), NEIGHBOUR)
    out["cluster"], out["mine"] = (links >> 16) % len(groups), links & 0xFFFF
    np.bitwise_or.at(out["theirs"], where.reshape(-1), bit[:, 1])
    start = np.searchsorted((links >> 16) // len(groups), np.arange(len(groups) + 1)).astype(
        np.uint32
    )
    most = int(np.diff(start).max())
    if most > BESIDE_MAX:
        raise MeshError(
            f"{most} neighbours of one cluster of samples, at most {BESIDE_MAX}: the tool has creases much closer "
            f"together than its samples; give a smaller {setting('spacing_m')}, or a tool without that detail"
        )
    return start, out


def pieces_of_lanes(pieces: I64) -> tuple[I64, I64]:
    """The two pieces that most samples of a cluster belong to, PIECE_NONE for no second, and the lanes of each.

    Shapes: pieces (n,); results (2,).
    """
    names, counts = np.unique(pieces, return_counts=True)
    found = np.asarray([*names[np.lexsort((names, -counts))], PIECE_NONE][:2], np.int64)
    return found, np.array([(1 << np.flatnonzero(pieces == piece)).sum() for piece in found])


def part_pieces(order: list[I64], pieces: I64) -> list[I64]:
    """Clusters that have room for the pieces of all their samples: one of more than two becomes several.

    Shapes: pieces (n,) of the samples, order: those of each cluster.
    """
    out = []
    for ids in order:
        left = ids
        while len(left):
            its = np.isin(pieces[left], pieces_of_lanes(pieces[left])[0])
            out.append(left[its])
            left = left[~its]
    return out


def hanging_together(position_m: F64, order: list[I64], reach_m: float) -> list[I64]:
    """Clusters whose samples hang together by steps of reach_m: one that reaches across a notch becomes several.

    Shapes: position_m (n, 3); order: samples of each cluster.
    """
    out = []
    for ids in order:
        pairs = cKDTree(position_m[ids]).query_pairs(reach_m, output_type="ndarray")
        links = coo_array((np.ones(len(pairs), bool), pairs.T), shape=(len(ids), len(ids)))
        part = connected_components(links, directed=False)[1]
        out += [ids[part == p] for p in np.unique(part)]
    return out


def pieces_of(samples: Samples, spacing_m: float, surface: Surface) -> I64:
    """The convex piece of each sample, (n,); a feature is of that of the nearest face sample."""
    face = np.flatnonzero(~samples.feature)
    faces = Samples(*(getattr(samples, f.name)[face] for f in fields(Samples)))
    order = cluster_order(faces, spacing_m, most=max(LANES, -(-len(face) // UNITS_MAX)))
    order = hanging_together(faces.position_m, order, NOTCH * spacing_m)
    normal = np.array([unit(faces.area_m2[ids].sum(axis=0)) for ids in order])
    of_face = mark_pieces(normal, faces.position_m, order, spacing_m, surface)
    nearest = cKDTree(faces.position_m).query(samples.position_m)[1]
    return np.asarray(of_face[nearest])


def make_shell(
    surface: Surface,
    spacing_m: float,
    tick: Callable[[float], None] = lambda _part: None,
    even: bool = False,
) -> Shell:
    """The complete shell of a tool mesh; even: see make_cells."""
    samples = make_samples(surface, spacing_m, part_of(tick, 0.0, SAMPLES_SHARE), even)
    pieces = pieces_of(samples, spacing_m, surface)
    order = part_pieces(cluster_order(samples, spacing_m), pieces)
    clusters = make_clusters(samples, order)
    alike: dict[bytes, tuple[I64, I64]] = {}
    for row, ids in zip(clusters, order, strict=True):
        mine = pieces[ids]
        key = mine.tobytes()
        if key not in alike:
            alike[key] = pieces_of_lanes(mine)
        row["piece"], row["piece_lanes"] = alike[key]
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
        float(rounded_up(radius)),
        float(rounded_up(np.linalg.norm(samples.position_m, axis=1).max())),
        float(np.linalg.norm(samples.area_m2[~samples.feature], axis=1).sum()),
        int(pieces[pieces < PIECE_NONE].max()) + 1,
    )
