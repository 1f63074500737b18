"""Openings of a surface: holes capped, gaps sewn with more and more reach, sheets made thick, left out or refused."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from crease.base.errors import MeshError
from crease.base.settings import setting
from crease.base.units import format_length
from crease.mesh import arrange, closing, topology
from crease.mesh.draft import WELD, Draft, drop_triangles, percent, plural, sew, turn_triangles
from crease.mesh.topology import Triangles

HOLE_AREA_SHARE = 0.1
"""Share of the surface that caps may add. A larger opening is the shape's own, and closing it would be a guess."""

HOLE_EDGES_MAX = 10_000

SEW_REACHES = (1e-5, 1e-4, 1e-3)
"""Shares of the diagonal within which edges that are still open are sewn, one after the other."""

SHEET_SHARE = 1 / 3
"""Caps of a piece of surface over this share of its own area: it encloses nothing, it may be a sheet."""

ENCLOSING = 0.9
"""Mean winding number behind a piece of surface from which on it encloses something, perhaps with others."""

PIECES_MANY, LOOKS = 200, 4
"""Over so many pieces each is judged by so many of its triangles: thousands of sheets are told in a second."""


def cap_holes(draft: Draft) -> None:
    """Close small plane holes; the rest is left to close_openings."""
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
        f"closed {plural(len(loops), 'hole')} with {plural(len(added), 'triangle')}, "
        f"{percent(cap_m2 / surface_m2)} of the surface"
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


def close_openings(draft: Draft) -> None:
    """What is still open: sewn with more reach, then piece by piece capped, made thick, left out, or refused."""
    if len(draft.loose_edges()) == 0:
        return
    _sew_wider(draft)
    if len(draft.loose_edges()) == 0:
        return
    pieces = _Pieces(draft)
    if pieces.sheets.any() and draft.wishes.sheet_m is None:
        pieces.leave_out_sheets()
    if pieces.sheets.any():
        _check_thickness(draft)
    pieces.close()


def _check_thickness(draft: Draft) -> None:
    """Errors: MeshError for sheets that would be thicker than the surface is large."""
    sheet_m = draft.wishes.sheet_m or 0.0
    span_m = float(np.ptp(draft.vertices[draft.triangles.reshape(-1)], axis=0).max())
    if sheet_m > span_m:
        raise MeshError(
            f"{setting('sheet_m', sheet_m)} is larger than the mesh ({format_length(span_m)}): use a smaller one"
        )


def _sew_wider(draft: Draft) -> None:
    """Vertices on open edges are taken in, then vertices within more and more of each other are welded."""
    if closing.is_apart(draft.vertices, draft.triangles, SEW_REACHES[-1] * draft.diagonal_m):
        turn_triangles(draft)
        return
    for share in (WELD, *SEW_REACHES):
        if share != WELD:
            sew(draft, share)
        triangles, taken = closing.split_edges(
            draft.vertices, draft.triangles, share * draft.diagonal_m
        )
        if taken:
            draft.triangles = triangles
            draft.notes.append(
                f"cut open edges at {taken:,} vert{'ex' if taken == 1 else 'ices'} that lie within "
                f"{format_length(share * draft.diagonal_m)} of them"
            )
            drop_triangles(draft)
        turn_triangles(draft)
        if len(draft.loose_edges()) == 0:
            return


def _some(triangles: npt.NDArray[np.int64], pieces: int) -> npt.NDArray[np.int64]:
    """Triangles of a piece by which it is judged: all, or LOOKS of them where there are very many pieces."""
    if pieces <= PIECES_MANY or len(triangles) <= LOOKS:
        return triangles
    return triangles[np.linspace(0, len(triangles) - 1, LOOKS).astype(np.int64)]


class _Pieces:
    """The connected pieces of an open surface, the caps of their openings, and which of them are sheets."""

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        count, self.of = closing.components(draft.triangles, draft.vertex_count)
        area = topology.areas_m2(draft.vertices, draft.triangles)
        self.area_m2 = np.bincount(self.of, weights=area, minlength=count)
        order = np.argsort(self.of, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(self.of, minlength=count))[:-1])
        loose = draft.loose_edges()
        is_open = np.zeros(count, bool)
        is_open[self.of[loose // 3]] = True
        self.rims = [
            closing.rims(draft.triangles[part], draft.vertex_count) if is_open[i] else []
            for i, part in enumerate(parts)
        ]
        self._caps: dict[int, list[closing.Cap]] = {}
        if draft.wishes.sheet_m is not None:
            self.sheets = self._capped_over(HOLE_AREA_SHARE)
            return
        self.sheets = self._capped_over(SHEET_SHARE)
        if self.sheets.any():
            # Behind a flat sheet the winding number is a half; pieces that enclose something together come near one.
            which = np.concatenate([_some(parts[i], count) for i in np.flatnonzero(self.sheets)])
            middle = draft.vertices[draft.triangles[which]].mean(axis=1)
            behind = 0.5 + arrange.Winding(draft.vertices, draft.triangles).at(
                middle, which.astype(np.int32)
            )
            weight = np.bincount(self.of[which], area[which], count)
            mean = np.bincount(self.of[which], area[which] * behind, count)
            self.sheets &= mean < ENCLOSING * np.maximum(weight, 1e-300)

    def caps_of(self, piece: int) -> list[closing.Cap]:
        """Caps of the openings of a piece."""
        if piece not in self._caps:
            self._caps[piece] = [closing.cap(self.draft.vertices, rim) for rim in self.rims[piece]]
        return self._caps[piece]

    def _capped_over(self, share: float) -> npt.NDArray[np.bool_]:
        """Whether the caps of each piece are over this share of its area; made only where that is not plain."""
        over = np.zeros(len(self.rims), bool)
        for i, rims in enumerate(self.rims):
            limit_m2 = share * self.area_m2[i]
            least_m2 = sum(closing.least_cap_m2(self.draft.vertices, rim) for rim in rims)
            over[i] = bool(rims) and (
                least_m2 > limit_m2 * (1.0 + 1e-9)
                or sum(cap.area_m2 for cap in self.caps_of(i)) > limit_m2
            )
        return over

    def leave_out_sheets(self) -> None:
        """Open pieces that enclose nothing vanish beside others that do.   Errors: MeshError without others."""
        draft, sheets = self.draft, self.sheets
        gone = sheets[self.of]
        place = draft.place(draft.vertices[draft.triangles[gone]][:1])
        share = float(self.area_m2[sheets].sum() / self.area_m2.sum())
        if share > 0.5:
            edges = len(draft.loose_edges())
            raise MeshError(
                f"is open and encloses nothing: {plural(edges, 'edge')} with a triangle on one side only, "
                f"one near {place}; give its sheets a thickness, such as {setting('sheet_m', 1e-3)}, "
                "or close it in the modeller"
            )
        draft.notes.append(
            f"left out {plural(int(sheets.sum()), 'open sheet')} that enclose nothing, {percent(share)} of the "
            f"surface, one near {place}; {setting('sheet_m', 1e-3)} gives them a thickness"
        )
        kept = np.flatnonzero(~sheets)
        self._caps = {n: self._caps[i] for n, i in enumerate(kept.tolist()) if i in self._caps}
        self.rims = [self.rims[i] for i in kept]
        self.area_m2 = self.area_m2[kept]
        number = np.cumsum(~sheets) - 1
        draft.triangles, self.of = draft.triangles[~gone], number[self.of[~gone]].astype(np.int32)
        self.sheets = sheets[kept]

    def close(self) -> None:
        """Caps on what encloses something, a thickness for sheets."""
        draft = self.draft
        vertices, parts = [draft.vertices], [draft.triangles[~self.sheets[self.of]]]
        count = draft.vertex_count
        for i in range(len(self.rims)):
            if self.sheets[i]:
                for leaf in closing.leaves(draft.triangles[self.of == i], draft.vertex_count):
                    points, solid = closing.thicken(
                        draft.vertices, leaf, draft.wishes.sheet_m or 0.0
                    )
                    vertices.append(points)
                    parts.append(solid + count)
                    count += len(points)
                continue
            for cap in self.caps_of(i):
                new = np.where(cap.triangles < draft.vertex_count, cap.triangles, count)
                parts.append(new.astype(np.int32))
                vertices.append(cap.points_m)
                count += len(cap.points_m)
        self._tell()
        # Sheets made thick are solids, which are united if they meet; what caps close may have faces inside.
        draft.layered = any(not sheet and self.caps_of(i) for i, sheet in enumerate(self.sheets))
        draft.vertices = np.concatenate(vertices)
        draft.triangles = np.concatenate(parts).astype(np.int32)

    def _tell(self) -> None:
        draft, whole_m2 = self.draft, float(self.area_m2.sum())
        solid = np.flatnonzero(~self.sheets).tolist()
        caps = [cap for i in solid for cap in self.caps_of(i)]
        if caps:
            largest = max(caps, key=lambda cap: cap.area_m2)
            draft.notes.append(
                f"closed {plural(len(caps), 'opening')}, "
                f"{percent(sum(cap.area_m2 for cap in caps) / whole_m2)} of the surface, "
                f"the largest {format_length(float(np.sqrt(largest.area_m2)))} wide near "
                f"{draft.place(largest.middle_m)}"
            )
        if self.sheets.any():
            draft.notes.append(
                f"made {plural(int(self.sheets.sum()), 'sheet')} {format_length(draft.wishes.sheet_m or 0.0)} thick, "
                f"{percent(float(self.area_m2[self.sheets].sum()) / whole_m2)} of the surface"
            )
