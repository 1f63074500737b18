"""Mends of a triangle surface: to closed, consistently oriented, free of self-intersection, with positive volume.

What is seen and done, in this order:
- equal vertices are welded; when edges stay open, vertices within WELD of the box diagonal too;
- triangles without area (two equal corners) and duplicates are dropped;
- triangles whose winding contradicts their neighbours are turned;
- plane or nearly plane holes of at most HOLE_AREA_SHARE of the surface are capped;
- what is still open is sewn with more reach, edges take in vertices that lie on them, and every opening of a piece of
  surface that encloses something is capped; pieces that enclose nothing are sheets: made thick, left out, or refused;
- slivers (altitude below SLIVER of the diagonal) are collapsed by manifold3d, which moves no surface further than that;
- shells that are inside out are turned; one that lies inside another as a cavity stays;
- shells that meet or overlap are united by manifold3d;
- a surface that still passes through itself, or has inner faces, is cut along these lines, and what parts inside from
  outside by the winding number is kept (crease.arrange).
Not seen: overlaps of parts of one shell inside one plane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import MeshError
from crease.base.units import METRES, format_length
from crease.mesh import arrange, closing, topology
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

SEW_REACHES = (1e-5, 1e-4, 1e-3)
"""Shares of the diagonal within which edges that are still open are sewn, one after the other."""

SHEET_SHARE = 1 / 3
"""Caps of a piece of surface over this share of its own area: it encloses nothing, it may be a sheet."""

ENCLOSING = 0.9
"""Mean winding number behind a piece of surface from which on it encloses something, perhaps with others."""

FLAT = 1e-9
"""Volume over diagonal cubed below which there is no inside."""


@dataclass(frozen=True)
class Wishes:
    """What the user said of a mesh: the unit of its file, and how thick its open sheets are (None: not said)."""

    unit_m: float = 1.0
    sheet_m: float | None = None


class Draft:
    """A surface on the bench, with the notes of what was done to it."""

    def __init__(
        self, vertices: Vertices, triangles: Triangles, wishes: Wishes | None = None
    ) -> None:
        self.vertices = vertices
        self.triangles = triangles
        self.wishes = wishes or Wishes()
        self.notes: list[str] = []
        self.layered = False
        """Whether there may be inner faces without a crossing: then winding numbers decide what stays."""
        used = vertices[triangles.reshape(-1)]
        self.diagonal_m = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))

    @property
    def vertex_count(self) -> int:
        return len(self.vertices)

    def place(self, points: npt.NDArray[np.float64]) -> str:
        """Where something is, for a person: mean of the points, in the unit of the file."""
        unit_m = self.wishes.unit_m
        name = next((n for n, metres in METRES.items() if metres == unit_m), "of the file")
        x, y, z = np.asarray(points).reshape(-1, 3).mean(axis=0) / unit_m
        return f"({x:.4g}, {y:.4g}, {z:.4g}) {name}"

    def area_m2(self) -> float:
        """Area of the surface."""
        return float(topology.areas_m2(self.vertices, self.triangles).sum())

    def volume_m3(self) -> float:
        """Volume that the surface encloses, parts that it encloses twice counted twice."""
        return float(topology.volumes_m3(self.vertices, self.triangles).sum())


def mend_surface(
    vertices: Vertices,
    triangles: Triangles,
    progress: Callable[[float], None] = lambda _part: None,
    wishes: Wishes | None = None,
) -> tuple[Vertices, Triangles, list[str]]:
    """Mend a surface; see the module.

    Output: vertices, triangles, and a note for each mend. progress is told the part done, 0..1.
    Errors: MeshError with what is wrong and the mend, without the file.
    """
    draft = Draft(vertices, triangles, wishes)
    stages = (
        _weld,
        _drop_triangles,
        _close,
        _close_openings,
        _collapse_slivers,
        _settle_shells,
        _cut_crossings,
        _check_closed,
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
        _sew(draft, WELD)
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


def _sew(draft: Draft, share: float) -> None:
    """Open edges whose ends lie within a share of the diagonal of others are welded."""
    if len(topology.unbalanced_edges(draft.triangles, draft.vertex_count)) == 0:
        return
    reach_m = share * draft.diagonal_m
    triangles, moved = closing.sew(draft.vertices, draft.triangles, reach_m)
    if moved == 0:
        return
    draft.triangles = triangles
    noun = "vertex" if moved == 1 else "vertices"
    draft.notes.append(f"sewed open edges: welded {moved:,} {noun} within {format_length(reach_m)}")
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
        changed = (triangles != draft.triangles).any(axis=1)
        share = topology.areas_m2(draft.vertices, triangles[changed]).sum() / draft.area_m2()
        draft.triangles = triangles
        draft.notes.append(
            f"turned {_plural(turned, 'triangle')} wound against the neighbours, {100.0 * share:.2g} % of the surface"
        )


def _cap_holes(draft: Draft) -> None:
    """Close small plane holes; the rest is left to _close_openings."""
    loops = topology.boundary_loops(draft.triangles, draft.vertex_count)
    if not loops or sum(map(len, loops)) > HOLE_EDGES_MAX:
        return
    caps = [closing.polygon_cap(draft.vertices, loop) for loop in loops]
    if any(cap is None for cap in caps):
        return
    added = np.concatenate([cap for cap in caps if cap is not None])
    surface_m2 = float(topology.areas_m2(draft.vertices, draft.triangles).sum())
    cap_m2 = float(topology.areas_m2(draft.vertices, added).sum())
    if cap_m2 > HOLE_AREA_SHARE * surface_m2 or _has_sheets(draft, added):
        return
    draft.triangles = np.concatenate([draft.triangles, added])
    draft.notes.append(
        f"closed {_plural(len(loops), 'hole')} with {_plural(len(added), 'triangle')}, "
        f"{100.0 * cap_m2 / surface_m2:.2g} % of the surface"
    )


def _has_sheets(draft: Draft, caps: Triangles) -> bool:
    """Whether these caps are large for some piece of the surface."""
    count, piece = closing.components(draft.triangles, draft.vertex_count)
    area_m2 = np.bincount(piece, topology.areas_m2(draft.vertices, draft.triangles), count)
    piece_of = np.zeros(draft.vertex_count, np.int64)
    piece_of[draft.triangles] = piece[:, None]
    cap_m2 = np.bincount(
        piece_of[caps[:, 0]], topology.areas_m2(draft.vertices, caps), minlength=count
    )
    return bool((cap_m2 > SHEET_SHARE * area_m2).any())


def _close_openings(draft: Draft) -> None:
    """What is still open: sewn with more reach, then piece by piece capped, made thick, left out, or refused."""
    if len(topology.unbalanced_edges(draft.triangles, draft.vertex_count)) == 0:
        return
    _sew_wider(draft)
    if len(topology.unbalanced_edges(draft.triangles, draft.vertex_count)) == 0:
        return
    pieces = _Pieces(draft)
    if pieces.sheets.any() and draft.wishes.sheet_m is None:
        pieces.leave_out_sheets()
    pieces.close()


def _sew_wider(draft: Draft) -> None:
    """Vertices on open edges are taken in, then vertices within more and more of each other are welded."""
    for share in (WELD, *SEW_REACHES):
        if share != WELD:
            _sew(draft, share)
        triangles, taken = closing.split_edges(
            draft.vertices, draft.triangles, share * draft.diagonal_m
        )
        if taken:
            draft.triangles = triangles
            draft.notes.append(
                f"cut open edges at {taken:,} vert{'ex' if taken == 1 else 'ices'} that lie within "
                f"{format_length(share * draft.diagonal_m)} of them"
            )
            _drop_triangles(draft)
        _turn_triangles(draft)
        if len(topology.unbalanced_edges(draft.triangles, draft.vertex_count)) == 0:
            return


class _Pieces:
    """The connected pieces of an open surface, the caps of their openings, and which of them are sheets."""

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        count, self.of = closing.components(draft.triangles, draft.vertex_count)
        area = topology.areas_m2(draft.vertices, draft.triangles)
        self.area_m2 = np.bincount(self.of, weights=area, minlength=count)
        self.rims = [
            closing.rims(draft.triangles[self.of == i], draft.vertex_count) for i in range(count)
        ]
        self.caps = [[closing.cap(draft.vertices, rim) for rim in rims] for rims in self.rims]
        self.cap_m2 = np.array([sum(cap.area_m2 for cap in caps) for caps in self.caps])
        if draft.wishes.sheet_m is not None:
            self.sheets = self.cap_m2 > HOLE_AREA_SHARE * self.area_m2
            return
        self.sheets = self.cap_m2 > SHEET_SHARE * self.area_m2
        if self.sheets.any():
            # Behind a flat sheet the winding number is a half; pieces that enclose something together come near one.
            middle = draft.vertices[draft.triangles].mean(axis=1)
            own = np.arange(len(middle), dtype=np.int32)
            behind = 0.5 + arrange.Winding(draft.vertices, draft.triangles).at(middle, own)
            mean = np.bincount(self.of, weights=area * behind, minlength=count) / self.area_m2
            self.sheets &= mean < ENCLOSING

    def leave_out_sheets(self) -> None:
        """Open pieces that enclose nothing vanish beside others that do.   Errors: MeshError without others."""
        draft, sheets = self.draft, self.sheets
        thin = self.of[:, None] == np.flatnonzero(sheets)
        gone = thin.any(axis=1)
        place = draft.place(draft.vertices[draft.triangles[gone]][:1])
        share = float(self.area_m2[sheets].sum() / self.area_m2.sum())
        if share > 0.5:
            edges = len(topology.unbalanced_edges(draft.triangles, draft.vertex_count))
            raise MeshError(
                f"is open and encloses nothing: {_plural(edges, 'edge')} with a triangle on one side only, "
                f"one near {place}; give its sheets a thickness, such as --sheet 1mm, or close it in the modeller"
            )
        draft.notes.append(
            f"left out {_plural(int(sheets.sum()), 'open sheet')} that enclose nothing, {100.0 * share:.2g} % of the "
            f"surface, one near {place}; --sheet 1mm gives them a thickness"
        )
        kept = np.flatnonzero(~sheets)
        self.rims, self.caps = [self.rims[i] for i in kept], [self.caps[i] for i in kept]
        self.cap_m2, self.area_m2 = self.cap_m2[kept], self.area_m2[kept]
        number = np.cumsum(~sheets) - 1
        draft.triangles, self.of = draft.triangles[~gone], number[self.of[~gone]].astype(np.int32)
        self.sheets = sheets[kept]

    def close(self) -> None:
        """Caps on what encloses something, a thickness for sheets."""
        draft = self.draft
        vertices, parts = [draft.vertices], [draft.triangles[~self.sheets[self.of]]]
        count = draft.vertex_count
        for i, caps in enumerate(self.caps):
            if self.sheets[i]:
                points, solid = closing.thicken(
                    draft.vertices, draft.triangles[self.of == i], draft.wishes.sheet_m or 0.0
                )
                vertices.append(points)
                parts.append(solid + count)
                count += len(points)
                continue
            for cap in caps:
                new = np.where(cap.triangles < draft.vertex_count, cap.triangles, count)
                parts.append(new.astype(np.int32))
                vertices.append(cap.points_m)
                count += len(cap.points_m)
        self._tell()
        draft.layered = True
        draft.vertices = np.concatenate(vertices)
        draft.triangles = np.concatenate(parts).astype(np.int32)

    def _tell(self) -> None:
        draft, whole_m2 = self.draft, float(self.area_m2.sum())
        caps = [cap for i, caps in enumerate(self.caps) if not self.sheets[i] for cap in caps]
        if caps:
            largest = max(caps, key=lambda cap: cap.area_m2)
            draft.notes.append(
                f"closed {_plural(len(caps), 'opening')}, "
                f"{100.0 * sum(cap.area_m2 for cap in caps) / whole_m2:.2g} % of the surface, "
                f"the largest {format_length(float(np.sqrt(largest.area_m2)))} wide near "
                f"{draft.place(largest.middle_m)}"
            )
        if self.sheets.any():
            draft.notes.append(
                f"made {_plural(int(self.sheets.sum()), 'sheet')} {format_length(draft.wishes.sheet_m or 0.0)} thick, "
                f"{100.0 * float(self.area_m2[self.sheets].sum()) / whole_m2:.2g} % of the surface"
            )


def _check_closed(draft: Draft) -> None:
    """Refuse what is still open, branched or one-sided."""
    open_edges = topology.unbalanced_edges(draft.triangles, draft.vertex_count)
    if len(open_edges) == 0:
        return
    start, end = topology.directed_edges(draft.triangles)
    place = draft.place(draft.vertices[[start[open_edges[0]], end[open_edges[0]]]])
    raise MeshError(
        f"could not be closed: {_plural(len(open_edges), 'edge')} with more triangles on one side than on the other, "
        f"one near {place}; repair it in the modeller"
    )


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


def _collapse_slivers(draft: Draft, share: float = SLIVER) -> None:
    """Triangles so thin that their normal is noise."""
    limit_m = share * draft.diagonal_m
    thin = int(np.count_nonzero(topology.altitudes_m(draft.vertices, draft.triangles) < limit_m))
    if thin == 0:
        return
    before = len(draft.triangles)
    trial = Draft(draft.vertices, draft.triangles)
    try:
        _from_manifold(trial, to_manifold(draft.vertices, draft.triangles).simplify(limit_m))
    except MeshError:
        draft.notes.append(f"keeps {_plural(thin, 'sliver')} thinner than {format_length(limit_m)}")
        return
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
    if count > 1 and not draft.layered and _boxes_meet(boxes, CROSSING * draft.diagonal_m):
        try:
            _unite(draft, shell, cavity)
        except MeshError:
            draft.layered = True


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
    area_m2, volume_m3 = draft.area_m2(), draft.volume_m3()
    if cavity.any() and not _outer_meet(draft, shell, cavity):
        return
    pairs = topology.crossing_pairs(draft.vertices, draft.triangles, CROSSING * draft.diagonal_m)
    if (shell[pairs[:, 0]] == shell[pairs[:, 1]]).any():
        draft.layered = True  # manifold3d takes each shell for free of crossings
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
        draft.notes.append(
            f"united {count:,} shells that meet into {_plural(now, 'shell')} "
            f"({_change(area_m2, draft.area_m2())} of the area, {_change(volume_m3, draft.volume_m3())} of the volume)"
        )


def _outer_meet(draft: Draft, shell: npt.NDArray[np.int32], cavity: npt.NDArray[np.bool_]) -> bool:
    """Whether shells meet other than by a cavity lying free inside its solid."""
    boxes = _shell_boxes(draft, shell, len(cavity))
    if _boxes_meet(boxes[~cavity], CROSSING * draft.diagonal_m):
        return True
    crossings, _ = topology.self_intersections(
        draft.vertices, draft.triangles, CROSSING * draft.diagonal_m
    )
    return crossings > 0


def _cut_crossings(draft: Draft) -> None:
    """Where the surface passes through itself or has inner faces, only its outer surface stays."""
    pairs = topology.crossing_pairs(draft.vertices, draft.triangles, CROSSING * draft.diagonal_m)
    open_before = len(topology.unbalanced_edges(draft.triangles, draft.vertex_count))
    if len(pairs) == 0 and open_before == 0 and not draft.layered:
        return
    area_m2, volume_m3 = draft.area_m2(), draft.volume_m3()
    made = arrange.cut_crossings(draft.vertices, draft.triangles)
    kept, _ = arrange.outer_surface(made)
    if len(kept) == 0:
        raise MeshError(
            "is flat: nothing lies between its triangles; give it thickness, such as --sheet 1mm"
        )
    place = draft.place(draft.vertices[draft.triangles[pairs[0]]]) if len(pairs) else ""
    draft.vertices, draft.triangles = topology.compact(made.vertices, kept)
    _close_cracks(draft)
    if len(pairs):
        draft.notes.append(
            f"passed through itself: cut {_plural(len(pairs), 'pair')} of triangles, one near {place}, and kept the "
            f"outer surface ({_change(area_m2, draft.area_m2())} of the area, "
            f"{_change(volume_m3, draft.volume_m3())} of the volume)"
        )
    elif abs(draft.area_m2() - area_m2) > 1e-9 * area_m2:
        draft.notes.append(
            f"dropped inner faces ({_change(area_m2, draft.area_m2())} of the area, "
            f"{_change(volume_m3, draft.volume_m3())} of the volume)"
        )
    _collapse_new_slivers(draft)


def _collapse_new_slivers(draft: Draft) -> None:
    """Slivers that cutting left, as far as no crossing comes back with it."""
    for share in (SLIVER, 0.1 * SLIVER, 0.01 * SLIVER):
        trial = Draft(draft.vertices, draft.triangles, draft.wishes)
        _collapse_slivers(trial, share)
        if (
            topology.self_intersections(
                trial.vertices, trial.triangles, CROSSING * draft.diagonal_m
            )[0]
            == 0
        ):
            draft.vertices, draft.triangles = trial.vertices, trial.triangles
            draft.notes.extend(note for note in trial.notes if not note.startswith("keeps"))
            return


def _change(before: float, after: float) -> str:
    percent = 100.0 * (after - before) / max(abs(before), 1e-300)
    return f"{percent:+.2g} %" if abs(percent) >= 1e-3 else "0 %"


def _close_cracks(draft: Draft) -> None:
    """Cracks that rounding left between pieces: caps without thickness."""
    loops = closing.rims(draft.triangles, draft.vertex_count)
    for loop in loops:
        cap = closing.cap(draft.vertices, loop)
        draft.vertices = np.concatenate([draft.vertices, cap.points_m])
        draft.triangles = np.concatenate([draft.triangles, cap.triangles])


def _check_solid(draft: Draft) -> None:
    """Refuse what has no inside."""
    volume_m3 = float(topology.volumes_m3(draft.vertices, draft.triangles).sum())
    if volume_m3 <= FLAT * draft.diagonal_m**3:
        raise MeshError("is flat: it has no volume; give it thickness")
