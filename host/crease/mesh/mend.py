"""Mends of a triangle surface: to closed, consistently oriented, free of self-intersection, with positive volume.

What is seen and done, in this order:
- equal vertices are welded; when edges stay open, vertices within WELD of the box diagonal too;
- triangles without area (two equal corners) and duplicates are dropped;
- triangles whose winding contradicts their neighbours are turned;
- plane or nearly plane holes of at most HOLE_AREA_SHARE of the surface are capped;
- what is still open is sewn with more reach, edges take in vertices that lie on them, and every opening of a piece of
  surface that encloses something is capped; pieces that enclose nothing are sheets: made thick, left out, or refused;
- shells without thickness beside others are left out, here and after uniting and cutting: folds;
- slivers (altitude below SLIVER of the diagonal) are collapsed by manifold3d, unless that moves the surface further,
  and what it leaves one by one (crease.mesh.slivers);
- vertices of a closed surface that lie on each other are welded where some of its triangles part nothing:
  it passes through itself there, along edges;
- shells that are inside out are turned; one that lies inside another as a cavity stays;
- shells that meet or overlap are united by manifold3d;
- a surface that still passes through itself, or has inner faces, is cut along these lines, and what parts inside from
  outside by the winding number is kept (crease.mesh.arrange); cracks, walls and slivers that are left are closed,
  dropped and collapsed.
Not seen: overlaps of parts of one shell inside one plane.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.base.units import format_length
from crease.mesh import arrange, closing, topology
from crease.mesh.draft import (
    WELD,
    Draft,
    Wishes,
    drop_triangles,
    percent,
    plural,
    renumber,
    sew,
    turn_triangles,
    weld,
)
from crease.mesh.openings import cap_holes, close_openings
from crease.mesh.slivers import mend_slivers
from crease.mesh.topology import Triangles, Vertices

SLIVER = 2e-6
"""Share of the diagonal below which a triangle's altitude makes its normal noise (float32: 1e-7 / 2e-6 = 3 degrees)."""

FLAT_TRIANGLE = 2e-7
"""Share of the diagonal below which the corners of a triangle lie on one line: what float32 keeps, twice."""

CRACKS = 1e-3
"""Share of the surface from which on what closes the cracks between cut pieces is told."""

LOOKED_AT = 1000
"""Triangles of a surface that are asked whether they part inside from outside."""

CROSSING = 2e-6
"""Share of the diagonal below which a passage of the surface through itself is taken as touching."""


ENCLOSED = 0.1
"""Share of a shell from which on something lies behind it, so that it is no fold, though its volumes cancel out."""

SPREAD = (0.62, 0.27, 0.11)
"""Where a triangle is asked what lies behind it, as shares of its corners, in turn: off its lines of symmetry, on which
others often end."""

PAIRED = 1e-9
"""How far the volume that manifold3d finds may be from that of the surface, by diagonal and area: rounding."""

FLAT = 1e-9
"""Volume over diagonal cubed below which there is no inside."""


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
    stages: tuple[Callable[[Draft], object], ...] = (
        weld,
        drop_triangles,
        _close,
        close_openings,
        _drop_flat_shells,
        _collapse_slivers,
        _weld_touching,
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
    if len(draft.loose_edges()):
        _drop_flat(draft)
        sew(draft, WELD)
        turn_triangles(draft)
        cap_holes(draft)


def _drop_flat(draft: Draft) -> None:
    """Triangles whose corners lie on one line, where the surface is less open without them: they close no gap."""
    flat = topology.altitudes_m(draft.vertices, draft.triangles) < FLAT_TRIANGLE * draft.diagonal_m
    rest = draft.triangles[~flat]
    if not flat.any() or len(rest) == 0:
        return
    if len(topology.unbalanced_edges(rest, draft.vertex_count)) < len(draft.loose_edges()):
        draft.triangles = rest
        draft.notes.append(
            f"dropped {plural(int(np.count_nonzero(flat)), 'triangle')} without area"
        )


def _check_closed(draft: Draft) -> None:
    """Refuse what is still open, branched or one-sided."""
    open_edges = draft.loose_edges()
    if len(open_edges) == 0:
        return
    start, end = topology.directed_edges(draft.triangles)
    place = draft.place(draft.vertices[[start[open_edges[0]], end[open_edges[0]]]])
    raise MeshError(
        f"could not be closed: {plural(len(open_edges), 'edge')} with more triangles on one side than on the other, "
        f"one near {place}; repair it in the modeller"
    )


def to_manifold(vertices: Vertices, triangles: Triangles, tolerance_m: float = 0.0) -> Any:
    """The surface as manifold3d has it.   Errors: MeshError when it refuses."""
    from manifold3d import Error, Manifold, Mesh64

    # Triangles of an edge of four it pairs as it likes, across the material too: they get vertices of their own.
    vertices, triangles = topology.parted(vertices, triangles)
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
    draft = Draft(vertices, triangles)
    if abs(solid.volume() - draft.volume_m3()) > PAIRED * draft.diagonal_m * draft.area_m2():
        raise MeshError(
            "is not a solid (manifold3d pairs its edges otherwise); repair it in the modeller"
        )
    return solid


def _from_manifold(draft: Draft, solid: Any) -> None:
    mesh = solid.to_mesh64()
    draft.vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    draft.triangles = np.array(mesh.tri_verts, dtype=np.int32)
    if len(draft.triangles) == 0:
        raise MeshError("is flat or vanishes when its shells are united; give it thickness")
    renumber(draft, draft.vertices)


def _collapse_slivers(draft: Draft, share: float = SLIVER, crossing: bool = True) -> bool:
    """Triangles so thin that their normal is noise. Output: whether fewer are left, without crossings if so wished."""
    limit_m = share * draft.diagonal_m
    thin = left = _thinner(draft, limit_m)
    before = len(draft.triangles)
    for collapse in (_simplified, _mended_in_place):
        trial = collapse(draft, limit_m) if left else None
        if trial is None or len(trial.loose_edges()) or (not crossing and _crosses(trial)):
            continue
        still = _thinner(trial, limit_m)
        if still < left:
            draft.vertices, draft.triangles, left = trial.vertices, trial.triangles, still
    if left < thin:
        draft.notes.append(
            f"collapsed {plural(thin - left, 'sliver')} thinner than {format_length(limit_m)}: "
            f"{before:,} triangles became {len(draft.triangles):,}"
        )
    if left and crossing:
        draft.notes.append(f"keeps {plural(left, 'sliver')} thinner than {format_length(limit_m)}")
    return left < thin


def _thinner(draft: Draft, limit_m: float) -> int:
    return int(np.count_nonzero(topology.altitudes_m(draft.vertices, draft.triangles) < limit_m))


def _crosses(draft: Draft) -> bool:
    reach_m = CROSSING * draft.diagonal_m
    return topology.self_intersections(draft.vertices, draft.triangles, reach_m)[0] > 0


def _simplified(draft: Draft, limit_m: float) -> Draft | None:
    """The surface as manifold3d simplifies it; None when it refuses, or moved more than limit_m."""
    made = Draft(draft.vertices, draft.triangles)
    try:
        _from_manifold(made, to_manifold(draft.vertices, draft.triangles).simplify(limit_m))
    except MeshError:
        return None
    return None if _moved(draft, made, limit_m) else made


def _mended_in_place(draft: Draft, limit_m: float) -> Draft | None:
    """The surface with its slivers mended one by one, less what lies on its own back then; None when nothing is left,
    or it moved more than limit_m."""
    triangles = mend_slivers(draft.vertices, draft.triangles, limit_m)
    triangles = topology.without_leaves(triangles)
    if len(triangles) == 0:
        return None
    made = Draft(*topology.compact(draft.vertices, triangles))
    return None if _moved(draft, made, limit_m) else made


def _moved(draft: Draft, made: Draft, limit_m: float) -> bool:
    return abs(made.volume_m3() - draft.volume_m3()) > limit_m * draft.area_m2()


def _weld_touching(draft: Draft) -> None:
    """Where a surface passes through itself along edges of both sheets, nothing crosses: these edges become one."""
    if draft.layered or len(draft.loose_edges()):
        return
    first, kind = topology.weld(np.round(draft.vertices / (WELD * draft.diagonal_m)))
    gone = draft.vertex_count - len(first)
    if gone == 0:
        return
    some = np.linspace(0, len(draft.triangles) - 1, LOOKED_AT).astype(np.int32)
    middle = draft.vertices[draft.triangles[some]].mean(axis=1)
    found = arrange.Winding(draft.vertices, draft.triangles).at(middle, some)
    if np.ptp(found) < 2.0 * arrange.CLEAR:
        return
    if len(topology.crossing_pairs(draft.vertices, draft.triangles, CROSSING * draft.diagonal_m)):
        return  # these are cut
    draft.vertices, draft.triangles = draft.vertices[first], kind[draft.triangles].astype(np.int32)
    draft.notes.append(f"touches itself: welded {plural(gone, 'pair')} of vertices")
    drop_triangles(draft)


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
    count, shell = draft.shells()
    parts_m3 = topology.volumes_m3(draft.vertices, draft.triangles)
    volume = np.bincount(shell, weights=parts_m3, minlength=count).astype(np.float64)
    boxes = _shell_boxes(draft, shell, count)
    # A shell lies in another as the file winds both: opposite senses make a cavity, whichever of the two is inside out.
    cavity = np.zeros(count, bool)
    turn = np.zeros(count, bool)
    for i in range(count) if (volume < 0.0).any() else ():
        round_it = _shell_round(draft, shell, volume, boxes, i)
        turn[i] = volume[round_it] < 0.0
        cavity[i] = (volume[i] < 0.0) != turn[i]
    if turn.any():
        wrong = turn[shell]
        draft.triangles = np.where(wrong[:, None], draft.triangles[:, ::-1], draft.triangles)
        draft.notes.append(
            f"was inside out: turned {plural(int(np.count_nonzero(wrong)), 'triangle')}"
            if count == 1
            else f"turned {int(np.count_nonzero(turn))} of {count:,} shells that were inside out"
        )
    if count > 1 and not draft.layered and _boxes_meet(boxes, CROSSING * draft.diagonal_m):
        try:
            _unite(draft, shell, cavity)
        except MeshError:
            draft.layered = True


def _shell_round(
    draft: Draft,
    shell: npt.NDArray[np.int32],
    volume: npt.NDArray[np.float64],
    boxes: npt.NDArray[np.float64],
    i: int,
) -> int:
    """The largest shell that holds the shell i, itself when none does. Looked for where one of them is inside out."""
    larger = np.abs(volume) > np.abs(volume[i])
    holding = ((boxes[:, 0] <= boxes[i, 0]) & (boxes[i, 1] <= boxes[:, 1])).all(axis=1)
    found = np.flatnonzero(larger & holding)
    if (volume[[i, *found]] > 0.0).all():
        return i
    point = draft.vertices[draft.triangles[np.argmax(shell == i), 0]]
    for j in found[np.argsort(-np.abs(volume[found]), kind="stable")].tolist():
        if _inside(point, draft.vertices, draft.triangles[shell == j]):
            return int(j)
    return i


def _unite(draft: Draft, shell: npt.NDArray[np.int32], cavity: npt.NDArray[np.bool_]) -> None:
    """One solid of all shells, less the cavities. Touches the mesh only when something meets."""
    from manifold3d import Manifold, OpType

    count, before = len(cavity), len(draft.triangles)
    was = draft.vertices, draft.triangles
    area_m2, volume_m3 = draft.area_m2(), draft.volume_m3()
    if cavity.any() and not _outer_meet(draft, shell, cavity):
        return
    pairs = topology.crossing_pairs(draft.vertices, draft.triangles, CROSSING * draft.diagonal_m)
    if (shell[pairs[:, 0]] == shell[pairs[:, 1]]).any():
        draft.layered = True  # manifold3d takes each shell for free of crossings
        return
    order = np.argsort(shell, kind="stable")
    parts = np.split(draft.triangles[order], np.cumsum(np.bincount(shell))[:-1])
    size = np.abs(np.bincount(shell, weights=topology.volumes_m3(draft.vertices, draft.triangles)))
    whole = Manifold()
    # The largest first: what lies free in a cavity is put there after the cavity was taken out.
    for is_cavity, run in groupby(np.argsort(-size, kind="stable"), lambda i: bool(cavity[i])):
        solids: list[Any] = []
        for i in run:
            points, corners = topology.compact(draft.vertices, parts[i])
            solids.append(to_manifold(points, corners[:, ::-1] if is_cavity else corners))
        part = Manifold.batch_boolean(solids, OpType.Add)
        whole = whole - part if is_cavity else whole + part
    _from_manifold(draft, whole)
    _drop_flat_shells(draft)
    now, _ = draft.shells()
    # Where solids touch along edges a union may leave a wall between them.
    draft.layered = bool(arrange.walls(draft.vertices, draft.triangles).any())
    if len(pairs) == 0 and not cavity.any() and 0 < count - now == _within(Draft(*was), shell):
        share = percent((area_m2 - draft.area_m2()) / area_m2)
        draft.notes.append(
            f"dropped {plural(count - now, 'shell')} wholly inside another, {share} of the surface"
        )
    elif now != count or len(draft.triangles) != before:
        draft.notes.append(
            f"united {count:,} shells that meet into {plural(now, 'shell')} "
            f"({_change(area_m2, draft.area_m2())} of the area, {_change(volume_m3, draft.volume_m3())} of the volume)"
        )


def _within(draft: Draft, shell: npt.NDArray[np.int32]) -> int:
    """Shells that lie in another, of shells that do not cross: how many."""
    boxes = _shell_boxes(draft, shell, int(shell.max()) + 1)
    margin_m, found = CROSSING * draft.diagonal_m, 0
    for i, (low, high) in enumerate(boxes):
        holding = ((boxes[:, 0] < low - margin_m) & (high + margin_m < boxes[:, 1])).all(axis=1)
        point = draft.vertices[draft.triangles[np.argmax(shell == i), 0]]
        found += any(
            _inside(point, draft.vertices, draft.triangles[shell == j])
            for j in np.flatnonzero(holding)
        )
    return found


def _drop_flat_shells(draft: Draft) -> None:
    """What encloses nothing beside what does: folds, and walls between solids that touch."""
    count, shell = draft.shells()
    volume_m3 = np.bincount(shell, weights=topology.volumes_m3(draft.vertices, draft.triangles))
    area_m2 = np.bincount(shell, weights=topology.areas_m2(draft.vertices, draft.triangles))
    thin_m = CROSSING * draft.diagonal_m
    boxes = _shell_boxes(draft, shell, count)
    # What is as thin as a line is flat whatever rounding makes of its volume.
    least_m2 = thin_m * np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
    flat = (2.0 * np.abs(volume_m3) <= thin_m * area_m2) | (area_m2 <= least_m2)
    if not flat.any() or flat.all() or len(draft.loose_edges()):
        return
    # One that passes through itself may enclose as much in one sense as in the other.
    some = np.flatnonzero(flat[shell])
    pairs = some[topology.crossing_pairs(draft.vertices, draft.triangles[some], thin_m)]
    through = pairs[shell[pairs[:, 0]] == shell[pairs[:, 1]], 0]
    for i in np.unique(shell[through]).tolist():
        flat[i] = not _encloses(draft.vertices, draft.triangles[shell == i], 2.0 * thin_m)
    if not flat.any():
        return
    draft.triangles = draft.triangles[~flat[shell]]
    share = percent(area_m2[flat].sum() / area_m2.sum())
    draft.notes.append(
        f"dropped {plural(int(np.count_nonzero(flat)), 'piece')} without volume, {share} of the surface"
    )


def _encloses(vertices: Vertices, triangles: Triangles, deep_m: float) -> bool:
    """Whether a closed surface goes round what lies so deep behind it, in either sense."""
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_m2 = np.linalg.norm(normal, axis=1)
    share = np.array([np.roll(SPREAD, k) for k in range(3)])
    points = np.einsum("pk,nkx->npx", share, corners)
    points -= (normal * (deep_m / np.maximum(double_m2, 1e-300))[:, None])[:, None]
    found = np.abs(arrange.Winding(vertices, triangles).at(points.reshape(-1, 3))) > 0.5
    behind = found.reshape(-1, len(share)).mean(axis=1)
    return bool((double_m2 * behind).sum() > ENCLOSED * double_m2.sum())


def _drop_walls(draft: Draft) -> None:
    """Walls between solids that touch, whose sides are cut otherwise, as far as the surface is closed without them."""
    if len(draft.loose_edges()):
        return
    rest = draft.triangles[~arrange.walls(draft.vertices, draft.triangles)]
    if len(rest) and len(topology.unbalanced_edges(rest, draft.vertex_count)) == 0:
        draft.triangles = rest


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
    open_before = len(draft.loose_edges())
    if len(pairs) == 0 and open_before == 0 and not draft.layered:
        return
    area_m2, volume_m3 = draft.area_m2(), draft.volume_m3()
    made = arrange.cut_crossings(draft.vertices, draft.triangles)
    kept, _ = arrange.outer_surface(made)
    if len(kept) == 0:
        raise MeshError(
            f"is flat: nothing lies between its triangles; give it thickness, such as {setting('sheet_m', 1e-3)}"
        )
    place = draft.place(draft.vertices[draft.triangles[pairs[0]]]) if len(pairs) else ""
    draft.vertices, draft.triangles = topology.compact(made.vertices, kept)
    _close_cracks(draft)
    _drop_walls(draft)
    _drop_flat_shells(draft)
    if len(pairs):
        draft.notes.append(
            f"passed through itself: cut {plural(len(pairs), 'pair')} of triangles, one near {place}, and kept the "
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
        if _collapse_slivers(draft, share, crossing=False):
            _drop_flat_shells(draft)
            return


def _change(before: float, after: float) -> str:
    if abs(after) > 1e3 * abs(before):
        return "all"
    percent = 100.0 * (after - before) / max(abs(before), 1e-300)
    digits = ".0f" if abs(percent) >= 99.5 else ".2g"
    return f"{percent:+{digits}} %" if abs(percent) >= 1e-3 else "0 %"


def _close_cracks(draft: Draft) -> None:
    """Cracks that rounding left between pieces: caps without thickness, which take leaves off that they lie on."""
    loops = closing.rims(draft.triangles, draft.vertex_count)
    area_m2, caps = draft.area_m2(), []
    for loop in loops:
        cap = closing.cap(draft.vertices, loop)
        caps.append(cap)
        draft.vertices = np.concatenate([draft.vertices, cap.points_m])
        draft.triangles = np.concatenate([draft.triangles, cap.triangles])
    share = sum(cap.area_m2 for cap in caps) / area_m2
    if share > CRACKS:
        widest = max(caps, key=lambda cap: cap.area_m2)
        draft.notes.append(
            f"cutting left openings: closed {plural(len(caps), 'opening')}, {percent(share)} of the surface, one near "
            f"{draft.place(widest.middle_m)}; the shape may be off there"
        )
    draft.triangles = topology.without_leaves(draft.triangles)
    draft.vertices, draft.triangles = topology.compact(draft.vertices, draft.triangles)


def _check_solid(draft: Draft) -> None:
    """Refuse what has no inside."""
    volume_m3 = float(topology.volumes_m3(draft.vertices, draft.triangles).sum())
    if volume_m3 <= FLAT * draft.diagonal_m**3:
        raise MeshError("is flat: it has no volume; give it thickness")
