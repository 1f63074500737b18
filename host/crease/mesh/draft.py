"""A surface on the bench: what is known of it, what was done to it, and the mends that need no new triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.base.units import METRES, format_length, format_place
from crease.mesh import closing, topology
from crease.mesh.topology import Indices, Triangles, Vertices

WELD = 1e-6
"""Share of the box diagonal within which open edges are sewn together: float32 keeps 1e-7."""


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
        self._loose: tuple[Triangles, Indices] | None = None
        self._shells: tuple[Vertices, Triangles, tuple[int, npt.NDArray[np.int32]]] | None = None
        used = vertices[triangles.reshape(-1)]
        self.diagonal_m = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))

    @property
    def vertex_count(self) -> int:
        return len(self.vertices)

    def loose_edges(self) -> Indices:
        """Edges with more triangles on one side than on the other, looked for once in the same array of triangles."""
        if self._loose is None or self._loose[0] is not self.triangles:
            found = topology.unbalanced_edges(self.triangles, self.vertex_count)
            self._loose = self.triangles, found
        return self._loose[1]

    def shells(self) -> tuple[int, npt.NDArray[np.int32]]:
        """Number of shells and the shell of each triangle, looked for once in the same arrays."""
        kept = self._shells
        if kept is None or kept[0] is not self.vertices or kept[1] is not self.triangles:
            found = topology.shells(self.vertices, self.triangles)
            kept = self._shells = self.vertices, self.triangles, found
        return kept[2]

    def place(self, points: npt.NDArray[np.float64]) -> str:
        """Where something is, for a person: mean of the points, in the unit of the file."""
        unit_m = self.wishes.unit_m
        name = next((n for n, metres in METRES.items() if metres == unit_m), "of the file")
        middle = np.asarray(points).reshape(-1, 3).mean(axis=0) / unit_m
        return f"{format_place(middle, self.diagonal_m / unit_m)} {name}"

    def area_m2(self) -> float:
        """Area of the surface."""
        return float(topology.areas_m2(self.vertices, self.triangles).sum())

    def volume_m3(self) -> float:
        """Volume that the surface encloses, parts that it encloses twice counted twice."""
        return float(topology.volumes_m3(self.vertices, self.triangles).sum())


def plural(count: int, noun: str) -> str:
    return f"{count:,} {noun}" + ("" if count == 1 else "s" if not noun.endswith("x") else "es")


def percent(share: float) -> str:
    """A share of 1 as `40 %`, two digits of it; 100 % in full."""
    return f"{100.0 * share:{'.0f' if share >= 0.995 else '.2g'}} %"


def renumber(draft: Draft, keys: npt.NDArray[np.float64]) -> int:
    """Make vertices with equal keys one.   Output: how many went."""
    first, kind = topology.weld(keys)
    gone = draft.vertex_count - len(first)
    if gone:
        draft.vertices = draft.vertices[first]
        draft.triangles = kind[draft.triangles].astype(np.int32)
    return gone


def weld(draft: Draft) -> None:
    """Equal vertices become one. No note: formats such as STL always need it."""
    renumber(draft, draft.vertices)
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)


def sew(draft: Draft, share: float) -> None:
    """Open edges whose ends lie within a share of the diagonal of others are welded."""
    if len(draft.loose_edges()) == 0:
        return
    reach_m = share * draft.diagonal_m
    triangles, moved = closing.sew(draft.vertices, draft.triangles, reach_m)
    if moved == 0:
        return
    draft.triangles = triangles
    noun = "vertex" if moved == 1 else "vertices"
    draft.notes.append(f"sewed open edges: welded {moved:,} {noun} within {format_length(reach_m)}")
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)
    drop_triangles(draft)


def drop_triangles(draft: Draft) -> None:
    """Triangles with two equal corners, and triangles that stand more than once."""
    a, b, c = draft.triangles.T
    whole = (a != b) & (b != c) & (c != a)
    if not whole.all():
        draft.notes.append(
            f"dropped {plural(int(np.count_nonzero(~whole)), 'triangle')} without area"
        )
        draft.triangles = draft.triangles[whole]
    if len(draft.triangles) == 0:
        raise MeshError("no triangle has an area; export it again")
    keep = _unique_triangles(draft)
    if not keep.all():
        draft.notes.append(f"dropped {plural(int(np.count_nonzero(~keep)), 'duplicate triangle')}")
        draft.triangles = draft.triangles[keep]
    if len(draft.triangles) == 0:
        raise MeshError(
            f"is flat, every triangle lies on its own back; give it thickness, such as {setting('sheet_m', 1e-3)}"
        )


def _unique_triangles(draft: Draft) -> npt.NDArray[np.bool_]:
    """Which triangles stay: one of each that stand more than once, none of two back to back inside a solid."""
    sorted_corners = np.sort(draft.triangles, axis=1)
    first, group = topology.weld(sorted_corners.astype(np.float64))
    size = np.bincount(group)
    keep = np.ones(len(draft.triangles), dtype=bool)
    if size.max() == 1:
        return keep
    a, b, c = draft.triangles.T
    turned = np.where(((a < b) + (b < c).astype(int) + (c < a)) == 2, 1, -1)
    net = np.bincount(group, weights=turned).astype(int)
    order = np.lexsort((-turned * np.sign(net[group]), group))
    rank = np.empty(len(order), dtype=np.int64)
    starts = np.r_[0, np.cumsum(size)[:-1]]
    rank[order] = np.arange(len(order)) - starts[group[order]]
    with_sheets = draft.wishes.sheet_m is not None
    wall = _walls(draft.triangles[first], net == 0, draft.vertex_count, with_sheets)
    keep[(size[group] > 1) & ((rank > 0) | wall[group])] = False
    return keep


def _walls(
    triangles: Triangles, doubled: npt.NDArray[np.bool_], vertex_count: int, with_sheets: bool
) -> npt.NDArray[np.bool_]:
    """Which of the triangles that stand in both senses are inner walls; the others are one triangle too many.

    triangles: one of each. Those in both senses that join each other are one piece. At most edges of its rim a wall
    meets two or more others, a part of the surface one, a sheet with two sides none (a wall too, unless with_sheets),
    and a closed surface has no rim.
    """
    _, edge, use = np.unique(
        topology.undirected_codes(triangles, vertex_count), return_inverse=True, return_counts=True
    )
    edge = edge.reshape(-1)
    owner = np.arange(3 * len(triangles)) // 3
    inner = (np.bincount(edge, doubled[owner]) == use) & (use == 2)
    joined = np.flatnonzero(inner[edge])
    graph = sparse.coo_matrix(
        (np.ones(len(joined), np.int8), (owner[joined], len(triangles) + edge[joined])),
        shape=(len(triangles) + len(use), len(triangles) + len(use)),
    )
    _, piece = csgraph.connected_components(graph, directed=False)
    rim = np.flatnonzero(doubled[owner] & ~inner[edge])
    of_rim = piece[owner[rim]]
    rim_use, count = use[edge[rim]], np.bincount(of_rim, minlength=len(piece))
    crowded = np.bincount(of_rim, rim_use > 2, minlength=len(piece))
    alone = np.bincount(of_rim, rim_use == 1, minlength=len(piece))
    wall = (2.0 * crowded > count) | ((2.0 * alone > count) & (not with_sheets))
    return np.asarray(doubled & wall[piece[: len(triangles)]])


def turn_triangles(draft: Draft) -> None:
    """Neighbours that contradict each other."""
    triangles, turned = topology.orient(draft.triangles, draft.vertex_count)
    if turned:
        changed = (triangles != draft.triangles).any(axis=1)
        share = topology.areas_m2(draft.vertices, triangles[changed]).sum() / draft.area_m2()
        draft.triangles = triangles
        draft.notes.append(
            f"turned {plural(turned, 'triangle')} wound against the neighbours, {percent(share)} of the surface"
        )
