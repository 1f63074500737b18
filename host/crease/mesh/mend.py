"""Mends of a triangle surface: to closed, consistently oriented, free of self-intersection, with positive volume.

What is seen and done, in this order:
- equal vertices are welded; when edges stay open, vertices within WELD of the box diagonal too;
- triangles without area (two equal corners) and duplicates are dropped;
- triangles whose winding contradicts their neighbours are turned;
- plane or nearly plane holes of at most HOLE_AREA_SHARE of the surface are capped;
- slivers (altitude below SLIVER of the diagonal) are collapsed by manifold3d, which moves no surface further than that;
- shells that are inside out are turned; one that lies inside another as a cavity stays;
- shells that meet or overlap are united by manifold3d;
- a surface that then still passes through itself is refused: its inside is not defined.
Not seen: overlaps of parts of one shell inside one plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import MeshError
from crease.base.units import format_length
from crease.mesh import topology
from crease.mesh.topology import Triangles, Vertices

WELD = 1e-6
"""Share of the box diagonal within which open edges are sewn together: float32 keeps 1e-7."""

SLIVER = 2e-6
"""Share of the diagonal below which a triangle's altitude makes its normal noise (float32: 1e-7 / 2e-6 = 3 degrees)."""

CROSSING = 2e-6
"""Share of the diagonal below which a passage of the surface through itself is taken as touching."""

HOLE_AREA_SHARE = 0.1
"""Share of the surface that caps may add. A larger opening is the shape's own, and closing it would be a guess."""

HOLE_EDGES_MAX = 10_000

FLAT = 1e-9
"""Volume over diagonal cubed below which there is no inside."""


class Draft:
    """A surface on the bench, with the notes of what was done to it."""

    def __init__(self, vertices: Vertices, triangles: Triangles) -> None:
        self.vertices = vertices
        self.triangles = triangles
        self.notes: list[str] = []
        used = vertices[triangles.reshape(-1)]
        self.diagonal_m = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))

    @property
    def vertex_count(self) -> int:
        return len(self.vertices)

    def place(self, points: npt.NDArray[np.float64]) -> str:
        """Where something is, for a person: mean of the points."""
        x, y, z = np.asarray(points).reshape(-1, 3).mean(axis=0)
        return f"({x:.4g}, {y:.4g}, {z:.4g}) m"


def mend_surface(
    vertices: Vertices,
    triangles: Triangles,
    progress: Callable[[float], None] = lambda _part: None,
) -> tuple[Vertices, Triangles, list[str]]:
    """Mend a surface; see the module.

    Output: vertices, triangles, and a note for each mend. progress is told the part done, 0..1.
    Errors: MeshError with what is wrong and the mend, without the file.
    """
    draft = Draft(vertices, triangles)
    stages = (
        _weld,
        _drop_triangles,
        _close,
        _check_closed,
        _collapse_slivers,
        _settle_shells,
        _check_crossings,
        _check_solid,
    )
    for done, stage in enumerate(stages):
        progress(done / len(stages))
        stage(draft)
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)
    return draft.vertices, draft.triangles, draft.notes


def _close(draft: Draft) -> None:
    """Sew, turn and cap where the surface is not closed and oriented already."""
    if len(topology.unbalanced_edges(draft.triangles, draft.vertex_count)):
        _sew(draft)
        _turn_triangles(draft)
        _cap_holes(draft)


def _plural(count: int, noun: str) -> str:
    return f"{count:,} {noun}" + ("" if count == 1 else "s" if not noun.endswith("x") else "es")


def _renumber(draft: Draft, keys: npt.NDArray[np.float64]) -> int:
    """Make vertices with equal keys one.   Output: how many went."""
    first, kind = topology.weld(keys)
    gone = draft.vertex_count - len(first)
    if gone:
        draft.vertices = draft.vertices[first]
        draft.triangles = kind[draft.triangles].astype(np.int32)
    return gone


def _weld(draft: Draft) -> None:
    """Equal vertices become one. No note: formats such as STL always need it."""
    _renumber(draft, draft.vertices)
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)


def _sew(draft: Draft) -> None:
    """Open edges whose ends lie within the tolerance of others are welded."""
    if topology.edge_use(draft.triangles, draft.vertex_count)[0] == 0:
        return
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    start, end = topology.directed_edges(draft.triangles)
    loose_edges = topology.unbalanced_edges(draft.triangles, draft.vertex_count)
    loose = np.unique(np.r_[start[loose_edges], end[loose_edges]])
    pairs = cKDTree(draft.vertices[loose]).query_pairs(
        WELD * draft.diagonal_m, output_type="ndarray"
    )
    if len(pairs) == 0:
        return
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(loose), len(loose)))
    _, group = connected_components(graph, directed=False)
    _, leader = np.unique(group, return_index=True)
    target = np.arange(draft.vertex_count)
    target[loose] = loose[leader[group]]
    draft.triangles = target[draft.triangles].astype(np.int32)
    moved = int(np.count_nonzero(target != np.arange(draft.vertex_count)))
    draft.notes.append(
        f"sewed open edges: welded {_plural(moved, 'vertex')} within {format_length(WELD * draft.diagonal_m)}".replace(
            "vertexes", "vertices"
        )
    )
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)
    _drop_triangles(draft)


def _drop_triangles(draft: Draft) -> None:
    """Triangles with two equal corners, and triangles that stand more than once."""
    a, b, c = draft.triangles.T
    whole = (a != b) & (b != c) & (c != a)
    if not whole.all():
        draft.notes.append(
            f"dropped {_plural(int(np.count_nonzero(~whole)), 'triangle')} without area"
        )
        draft.triangles = draft.triangles[whole]
    if len(draft.triangles) == 0:
        raise MeshError("no triangle has an area; export it again")
    keep = _unique_triangles(draft)
    if not keep.all():
        draft.notes.append(f"dropped {_plural(int(np.count_nonzero(~keep)), 'duplicate triangle')}")
        draft.triangles = draft.triangles[keep]
    if len(draft.triangles) == 0:
        raise MeshError("is flat, every triangle lies on its own back; give it thickness")


def _unique_triangles(draft: Draft) -> npt.NDArray[np.bool_]:
    """Which triangles stay: one of each that stand more than once, none of two back to back inside a solid."""
    sorted_corners = np.sort(draft.triangles, axis=1)
    _, group = topology.weld(sorted_corners.astype(np.float64))
    size = np.bincount(group)
    keep = np.ones(len(draft.triangles), dtype=bool)
    if size.max() == 1:
        return keep
    a, b, c = draft.triangles.T
    turned = np.where(((a < b) + (b < c).astype(int) + (c < a)) == 2, 1, -1)
    net = np.bincount(group, weights=turned).astype(int)
    _, edge, use = np.unique(
        topology.undirected_codes(draft.triangles, draft.vertex_count),
        return_inverse=True,
        return_counts=True,
    )
    others = use[edge].reshape(-1, 3)
    # Twice in opposite senses: with one more triangle at every edge it is one triangle too many, else an inner wall.
    spare = (others - size[group][:, None] == 1).all(axis=1)
    order = np.lexsort((-turned * np.sign(net[group]), group))
    rank = np.empty(len(order), dtype=np.int64)
    starts = np.r_[0, np.cumsum(size)[:-1]]
    rank[order] = np.arange(len(order)) - starts[group[order]]
    wall = (net[group] == 0) & ~spare
    multiple = size[group] > 1
    keep[multiple & ((rank > 0) | wall)] = False
    return keep


def _turn_triangles(draft: Draft) -> None:
    """Neighbours that contradict each other."""
    triangles, turned = topology.orient(draft.triangles, draft.vertex_count)
    if turned:
        draft.triangles = triangles
        draft.notes.append(f"turned {_plural(turned, 'triangle')} wound against the neighbours")


def _cap_holes(draft: Draft) -> None:
    """Close small plane holes; the rest is refused by _check_closed."""
    loops = topology.boundary_loops(draft.triangles, draft.vertex_count)
    if not loops or sum(map(len, loops)) > HOLE_EDGES_MAX:
        return
    caps = [_cap(draft.vertices, loop) for loop in loops]
    if any(cap is None for cap in caps):
        return
    added = np.concatenate([cap for cap in caps if cap is not None])
    surface_m2 = float(topology.areas_m2(draft.vertices, draft.triangles).sum())
    cap_m2 = float(topology.areas_m2(draft.vertices, added).sum())
    if cap_m2 > HOLE_AREA_SHARE * surface_m2:
        return
    draft.triangles = np.concatenate([draft.triangles, added])
    draft.notes.append(
        f"closed {_plural(len(loops), 'hole')} with {_plural(len(added), 'triangle')}, "
        f"{100.0 * cap_m2 / surface_m2:.2g} % of the surface"
    )


def _cap(vertices: Vertices, loop: Sequence[int]) -> Triangles | None:
    """Triangles over a rim, or None when it is too far from a plane to be seen as a polygon."""
    from manifold3d import triangulate

    rim = vertices[list(loop)]
    centred = rim - rim.mean(axis=0)
    normal = 0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(normal))
    if size <= 0.0:
        return None
    normal /= size
    if np.abs(centred @ normal).max() > 0.2 * np.sqrt(size):
        return None
    across = np.linalg.svd(centred - np.outer(centred @ normal, normal), full_matrices=False)[2][0]
    flat = np.ascontiguousarray(
        np.stack([centred @ across, centred @ np.cross(normal, across)], axis=1)
    )
    cap = np.asarray(triangulate([flat]))
    if len(cap) != len(loop) - 2:
        return None
    number = np.asarray(loop, dtype=np.int32)
    triangles: Triangles = number[cap.reshape(-1, 3)]
    return triangles


def _check_closed(draft: Draft) -> None:
    """Refuse what is still open, branched or one-sided."""
    open_edges = topology.unbalanced_edges(draft.triangles, draft.vertex_count)
    if len(open_edges) == 0:
        return
    start, end = topology.directed_edges(draft.triangles)
    place = draft.place(draft.vertices[[start[open_edges[0]], end[open_edges[0]]]])
    boundary, branched = topology.edge_use(draft.triangles, draft.vertex_count)
    if boundary:
        raise MeshError(
            f"is open: {_plural(boundary, 'edge')} with a triangle on one side only, one near {place}; "
            "close the surface in the modeller"
        )
    if branched:
        raise MeshError(
            f"has {_plural(branched, 'edge')} where an odd number of triangles meet, one near {place}; "
            "remove the inner faces in the modeller"
        )
    raise MeshError(f"has one side only (like a Moebius strip), near {place}; make it a solid")


def to_manifold(vertices: Vertices, triangles: Triangles, tolerance_m: float = 0.0) -> Any:
    """The surface as manifold3d has it.   Errors: MeshError when it refuses."""
    from manifold3d import Error, Manifold, Mesh64

    solid = Manifold(
        Mesh64(
            vert_properties=np.ascontiguousarray(vertices, dtype=np.float64),
            tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
            tolerance=tolerance_m,
        )
    )
    if solid.status() != Error.NoError:
        raise MeshError(
            f"is not a solid (manifold3d: {solid.status().name}); repair it in the modeller"
        )
    return solid


def _from_manifold(draft: Draft, solid: Any) -> None:
    mesh = solid.to_mesh64()
    draft.vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    draft.triangles = np.array(mesh.tri_verts, dtype=np.int32)
    if len(draft.triangles) == 0:
        raise MeshError("is flat or vanishes when its shells are united; give it thickness")
    _renumber(draft, draft.vertices)


def _collapse_slivers(draft: Draft) -> None:
    """Triangles so thin that their normal is noise."""
    limit_m = SLIVER * draft.diagonal_m
    thin = int(np.count_nonzero(topology.altitudes_m(draft.vertices, draft.triangles) < limit_m))
    if thin == 0:
        return
    before = len(draft.triangles)
    trial = Draft(draft.vertices, draft.triangles)
    _from_manifold(trial, to_manifold(draft.vertices, draft.triangles).simplify(limit_m))
    left = int(np.count_nonzero(topology.altitudes_m(trial.vertices, trial.triangles) < limit_m))
    if len(topology.unbalanced_edges(trial.triangles, trial.vertex_count)) or left >= thin:
        draft.notes.append(f"keeps {_plural(thin, 'sliver')} thinner than {format_length(limit_m)}")
        return
    draft.vertices, draft.triangles = trial.vertices, trial.triangles
    draft.notes.append(
        f"collapsed {_plural(thin - left, 'sliver')} thinner than {format_length(limit_m)}: "
        f"{before:,} triangles became {len(draft.triangles):,}"
    )


def _shell_boxes(draft: Draft, shell: npt.NDArray[np.int32], count: int) -> npt.NDArray[np.float64]:
    """Low and high corner of each shell, (count, 2, 3)."""
    low = np.full((count, 3), np.inf)
    high = np.full((count, 3), -np.inf)
    corners = draft.vertices[draft.triangles]
    np.minimum.at(low, shell, corners.min(axis=1))
    np.maximum.at(high, shell, corners.max(axis=1))
    return np.stack([low, high], axis=1)


def _boxes_meet(boxes: npt.NDArray[np.float64], margin_m: float) -> bool:
    """Whether any two boxes overlap: sweep along x."""
    order = np.argsort(boxes[:, 0, 0])
    low, high = boxes[order, 0], boxes[order, 1] + margin_m
    for i in range(len(order) - 1):
        end = int(np.searchsorted(low[:, 0], high[i, 0], side="right"))
        rest = slice(i + 1, end)
        if ((low[rest] <= high[i]) & (low[i] <= high[rest])).all(axis=1).any():
            return True
    return False


def _inside(point: npt.NDArray[np.float64], vertices: Vertices, triangles: Triangles) -> bool:
    """Whether a closed surface winds round a point (sum of solid angles)."""
    a, b, c = (vertices[triangles[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    bottom = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return bool(abs(2.0 * np.arctan2(top, bottom).sum()) > 2.0 * np.pi)


def _settle_shells(draft: Draft) -> None:
    """Turn shells that are inside out, and unite shells that meet."""
    count, shell = topology.shells(draft.vertices, draft.triangles)
    parts_m3 = topology.volumes_m3(draft.vertices, draft.triangles)
    volume = np.bincount(shell, weights=parts_m3, minlength=count).astype(np.float64)
    boxes = _shell_boxes(draft, shell, count)
    cavity = np.array(
        [volume[i] < 0.0 and _is_cavity(draft, shell, volume, boxes, i) for i in range(count)]
    )
    turn = (volume < 0.0) & ~cavity
    if turn.any():
        wrong = turn[shell]
        draft.triangles[wrong] = draft.triangles[wrong][:, ::-1]
        draft.notes.append(
            f"was inside out: turned {_plural(int(np.count_nonzero(wrong)), 'triangle')}"
            if count == 1
            else f"turned {int(np.count_nonzero(turn))} of {count:,} shells that were inside out"
        )
    if count > 1 and _boxes_meet(boxes, CROSSING * draft.diagonal_m):
        _unite(draft, shell, cavity)


def _is_cavity(
    draft: Draft,
    shell: npt.NDArray[np.int32],
    volume: npt.NDArray[np.float64],
    boxes: npt.NDArray[np.float64],
    i: int,
) -> bool:
    """Whether the inside-out shell i lies inside a larger one."""
    larger = np.abs(volume) > np.abs(volume[i])
    holding = ((boxes[:, 0] <= boxes[i, 0]) & (boxes[i, 1] <= boxes[:, 1])).all(axis=1)
    point = draft.vertices[draft.triangles[np.argmax(shell == i), 0]]
    return any(
        _inside(point, draft.vertices, draft.triangles[shell == j])
        for j in np.flatnonzero(larger & holding).tolist()
    )


def _unite(draft: Draft, shell: npt.NDArray[np.int32], cavity: npt.NDArray[np.bool_]) -> None:
    """One solid of all shells, less the cavities. Touches the mesh only when something meets."""
    from manifold3d import Manifold, OpType

    count, before = len(cavity), len(draft.triangles)
    if cavity.any() and not _outer_meet(draft, shell, cavity):
        return
    order = np.argsort(shell, kind="stable")
    parts = np.split(draft.triangles[order], np.cumsum(np.bincount(shell))[:-1])
    solids: list[Any] = []
    holes: list[Any] = []
    for part, is_cavity in zip(parts, cavity, strict=True):
        points, corners = topology.compact(draft.vertices, part)
        solid = to_manifold(points, corners[:, ::-1] if is_cavity else corners)
        (holes if is_cavity else solids).append(solid)
    whole = Manifold.batch_boolean(solids, OpType.Add)
    if holes:
        whole = whole - Manifold.batch_boolean(holes, OpType.Add)
    _from_manifold(draft, whole)
    now = topology.shells(draft.vertices, draft.triangles)[0]
    if now != count or len(draft.triangles) != before:
        draft.notes.append(f"united {count:,} shells that meet into {_plural(now, 'shell')}")


def _outer_meet(draft: Draft, shell: npt.NDArray[np.int32], cavity: npt.NDArray[np.bool_]) -> bool:
    """Whether shells meet other than by a cavity lying free inside its solid."""
    boxes = _shell_boxes(draft, shell, len(cavity))
    if _boxes_meet(boxes[~cavity], CROSSING * draft.diagonal_m):
        return True
    crossings, _ = topology.self_intersections(
        draft.vertices, draft.triangles, CROSSING * draft.diagonal_m
    )
    return crossings > 0


def _check_crossings(draft: Draft) -> None:
    """Refuse a surface that passes through itself."""
    count, pair = topology.self_intersections(
        draft.vertices, draft.triangles, CROSSING * draft.diagonal_m
    )
    if count:
        place = draft.place(draft.vertices[draft.triangles[list(pair)]])
        raise MeshError(
            f"passes through itself: {_plural(count, 'pair')} of triangles cross, one near {place}; "
            "unite its parts in the modeller"
        )


def _check_solid(draft: Draft) -> None:
    """Refuse what has no inside."""
    volume_m3 = float(topology.volumes_m3(draft.vertices, draft.triangles).sum())
    if volume_m3 <= FLAT * draft.diagonal_m**3:
        raise MeshError("is flat: it has no volume; give it thickness")
