"""What cells of the voxmap see: the tables KINDS and FACETS of the image, and distances from planes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import spatial

from crease.bake.layout import FACET, KIND
from crease.bake.surface import Surface
from crease.bake.vectors import without_dust
from crease.base.native import ffi, lib

F64 = npt.NDArray[np.float64]

KINDS_MAX = 0x10000
"""Rows that an entry of a cell table can tell apart."""
SHORT_ONE = 32767.0
"""What a number of 16 bits counts as 1."""
CORNERS_FEW = 24
"""Up to so many corners the sides of their hull are looked for among all ways from one to another."""
NUMBERS_AT_ONCE = 2_000_000
"""Held at a time where many directions are tried."""
END_POINTS = 9
"""Points beside a side of a facet's rectangle that tell whether the surface goes on there."""
END_SINE = 0.5
"""It does where it falls off by less than 30 degrees, over a voxel."""
FACETS_AT_ONCE = 4096
"""Facets whose ends are looked for at a time."""
MERGE_STEPS = 6
"""How often rows are merged more coarsely, until they fit."""


def rectangles(normals: F64, points_m: F64) -> tuple[npt.NDArray[np.int16], F64, F64]:
    """The rectangle of least girth round each set of points, seen along a unit normal: a side's direction, its ranges.

    Of least area it would be any of three round a triangle. One side lies along a side of the points' hull. The
    direction is a unit vector times SHORT_ONE; ranges are along it as it is rounded, and along normal x direction.
    Shapes: normals (m, 3); points_m (m, n, 3), in one line or wider; result (m, 3), (m, 2), (m, 2).
    """
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frames = np.stack([first, np.cross(normals, first)], axis=1)
    flat = np.einsum("mnk,mak->mna", points_m, frames)
    if flat.shape[1] > CORNERS_FEW:
        along = np.concatenate([_of_hull(points[None]) for points in flat])
    else:
        along = _of_least_girth(flat, *np.triu_indices(flat.shape[1], 1))
    short = np.rint(SHORT_ONE * np.einsum("ma,mak->mk", along, frames)).astype(np.int16)
    side = short / SHORT_ONE
    reached = np.einsum("mnk,mak->mna", points_m, np.stack([side, np.cross(normals, side)], axis=1))
    return short, reached.min(axis=1), reached.max(axis=1)


def _of_hull(flat: F64) -> F64:
    """As _of_least_girth, of many points, along the sides of their hull. Shapes: flat (1, n, 2); result (1, 2)."""
    try:
        flat = flat[:, spatial.ConvexHull(flat[0]).vertices]
    except spatial.QhullError:  # in one line, or next to it: its ends
        end = np.argmax(((flat[0] - flat[0, 0]) ** 2).sum(axis=1))
        flat = flat[:, [end, np.argmax(((flat[0] - flat[0, end]) ** 2).sum(axis=1))]]
    corner = np.arange(flat.shape[1])
    return _of_least_girth(flat, corner, np.roll(corner, -1))


def _of_least_girth(flat: F64, start: npt.NDArray[np.intp], end: npt.NDArray[np.intp]) -> F64:
    """A side of the rectangle of least girth, of those along the ways from some points to others.

    Shapes: flat (m, n, 2); start, end (k,); result (m, 2), unit.
    """
    ways = flat[:, end] - flat[:, start]
    length = np.linalg.norm(ways, axis=2)
    ways = np.where(length[..., None] > 0.0, ways, [1.0, 0.0])
    ways /= np.where(length > 0.0, length, 1.0)[..., None]
    girth = np.full(length.shape, np.inf)
    step = max(1, NUMBERS_AT_ONCE // flat[..., 0].size)
    for k in range(0, len(start), step):
        x = np.einsum("mka,mna->mkn", ways[:, k : k + step], flat)
        y = np.einsum("mka,mna->mkn", ways[:, k : k + step] @ [[0.0, -1.0], [1.0, 0.0]], flat)
        girth[:, k : k + step] = np.ptp(x, axis=2) + np.ptp(y, axis=2)
    girth[length <= 0.0] = np.inf
    # The first of those that are as good.
    best = np.argmax(girth <= girth.min(axis=1, keepdims=True) * (1.0 + 1e-9), axis=1)
    return np.asarray(ways[np.arange(len(flat)), best])


class Kinds:
    """The table of what cells see, without repetition, and the facets it names."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self.bent = np.zeros(len(surface.facet_patch), bool)
        """Facets of round surfaces: planes, but felt as their patch."""
        self._rows: list[tuple[int, tuple[int, ...]]] = [(int(lib.CR_KIND_EMPTY), ())]
        self._index: dict[tuple[int, tuple[int, ...]], int] = {self._rows[0]: 0}
        self._planes: list[tuple[F64, int, int]] = []
        self._facets: list[npt.NDArray[Any]] = []  # those of the mesh that each plane stands for
        self._planar: dict[int, int] = {}
        self._curved: dict[int, int] = {}
        self._local: dict[tuple[int, bytes], int] = {}

    def planar(self, facet: int) -> int:
        """Index in the image of a real facet."""
        if facet not in self._planar:
            patch = int(self._surface.facet_patch[facet])
            what = lib.CR_FACET_OF_CURVED if self.bent[facet] else lib.CR_FACET_FLAT
            plane = self._surface.facet_plane[facet], patch, int(what)
            self._planar[facet] = self._add(plane, np.array([facet]))
        return self._planar[facet]

    def curved(self, patch: int) -> int:
        """Index in the image of the facet that stands for a curved patch."""
        if patch not in self._curved:
            mine = np.flatnonzero(self._surface.facet_patch == patch)
            plane = self._mean(mine), patch, int(lib.CR_FACET_CURVED)
            self._curved[patch] = self._add(plane, mine)
        return self._curved[patch]

    def local(self, facets: npt.NDArray[np.int64], patch: int) -> int:
        """Index of the facet that stands for some facets of a curved patch near one cell."""
        key = patch, facets.tobytes()
        if key not in self._local:
            plane = self._mean(facets), patch, int(lib.CR_FACET_CURVED)
            self._local[key] = self._add(plane, facets)
        return self._local[key]

    def _add(self, plane: tuple[F64, int, int], facets: npt.NDArray[Any]) -> int:
        self._planes.append(plane)
        self._facets.append(facets)
        return len(self._planes) - 1

    def _mean(self, facets: npt.NDArray[Any]) -> F64:
        area = self._surface.facet_area_m2[facets][:, None]
        plane = (self._surface.facet_plane[facets] * area).sum(axis=0) / max(area.sum(), 1e-300)
        length = float(np.linalg.norm(plane[:3]))
        if length < 1e-3:
            return np.array([0.0, 0.0, 1.0, 0.0])
        return np.asarray(plane / length)

    def index(self, kind: int, facets: tuple[int, ...]) -> int:
        """Index of a table row, made when new."""
        key = (kind, facets)
        if key not in self._index:
            self._index[key] = len(self._rows)
            self._rows.append(key)
        return self._index[key]

    def records(self, voxel_m: float) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """The image sections KINDS and FACETS."""
        kinds = np.zeros(len(self._rows), KIND)
        for row, (kind, facets) in zip(kinds, self._rows, strict=True):
            row["kind"], row["count"] = kind, len(facets)
            row["facet"][: len(facets)] = facets
        planes = np.zeros(len(self._planes), FACET)
        for row, (plane, patch, curved) in zip(planes, self._planes, strict=True):
            row["normal"], row["offset_m"] = without_dust(np.array(plane[:3]), 1.0), plane[3]
            row["patch"], row["curved"] = patch, curved
        self._put_rectangles(planes)
        self._put_ends(planes, voxel_m)
        return kinds, planes

    def _put_rectangles(self, planes: npt.NDArray[Any]) -> None:
        """Where each facet of the image lies in its plane: all of as many corners at once."""
        mesh, facet_of = self._surface.mesh, self._surface.facet_of
        order = np.argsort(facet_of, kind="stable")
        start = np.searchsorted(facet_of[order], np.arange(len(self._surface.facet_patch) + 1))
        triangles = [order[start[f] : start[f + 1]] for mine in self._facets for f in mine]
        row = np.repeat(np.arange(len(self._facets)), [len(mine) for mine in self._facets])
        row = np.repeat(row, [3 * len(mine) for mine in triangles])
        corner = mesh.triangles[np.concatenate(triangles)].reshape(-1)
        row, corner = np.divmod(
            np.unique(row * len(mesh.vertices_m) + corner), len(mesh.vertices_m)
        )
        count = np.bincount(row, minlength=len(planes))
        first = np.cumsum(count) - count
        normals = np.array([plane[:3] for plane, *_ in self._planes])
        for corners in np.unique(count).tolist():
            mine = np.flatnonzero(count == corners)
            points = mesh.vertices_m[corner[first[mine, None] + np.arange(corners)]]
            found = rectangles(normals[mine], points)
            planes["along"][mine], planes["low_m"][mine], planes["high_m"][mine] = found

    def _put_ends(self, planes: npt.NDArray[Any], reach_m: float) -> None:
        """Beyond which sides of their rectangles flat facets have no surface, a voxel on: along most of the side."""
        flat = np.flatnonzero(planes["curved"] == int(lib.CR_FACET_FLAT))
        for rows in np.split(flat, range(FACETS_AT_ONCE, len(flat), FACETS_AT_ONCE)):
            mine = planes[rows]
            normal, along = mine["normal"].astype(np.float64), mine["along"] / SHORT_ONE
            axes = np.stack([along, np.cross(normal, along)], axis=1)
            low, high = mine["low_m"].astype(np.float64), mine["high_m"].astype(np.float64)
            ends = np.zeros(len(rows), np.uint8)
            for side in range(int(lib.CR_FACET_SIDES)):
                axis, is_high = divmod(side, 2)
                beyond = high[:, axis] + reach_m if is_high else low[:, axis] - reach_m
                other = np.linspace(low[:, 1 - axis], high[:, 1 - axis], END_POINTS, axis=1)
                points = (
                    (normal * mine["offset_m"][:, None])[:, None]
                    + (axes[:, axis] * beyond[:, None])[:, None]
                    + axes[:, None, 1 - axis] * other[..., None]
                )
                phi, _ = self._surface.signed_distance(points.reshape(-1, 3))
                ended = (phi.reshape(other.shape) > END_SINE * reach_m).mean(axis=1) > 0.5
                ends |= ended.astype(np.uint8) << np.uint8(side)
            planes["ends"][rows] = ends

    def merged(self, voxel_m: float) -> npt.NDArray[np.int32]:
        """The new index of every row, after alike rows became one so that at most KINDS_MAX are left.

        Rows of MIXED cells are alike when their facets have the same patches, and nearly the same normals and offsets;
        how nearly is relaxed until the rows fit. Then flat facets of a curved patch stand for the patch. A facet that
        stands for others is where any of them is. Rows beyond those that fit even so become the last one.
        """
        index = np.arange(len(self._rows), dtype=np.int32)
        for step in range(MERGE_STEPS):
            if len(self._rows) <= KINDS_MAX:
                break
            coarse = step + 1 < MERGE_STEPS
            keys = [
                self._alike(row, voxel_m * 2.0**step, 0.05 * 2.0**step, coarse)
                for row in self._rows
            ]
            first: dict[Any, int] = {}
            kept: list[tuple[int, tuple[int, ...]]] = []
            place = np.empty(len(keys), np.int32)
            wider: dict[int, list[int]] = {}
            for i, key in enumerate(keys):
                if key not in first:
                    first[key] = len(kept)
                    kept.append(self._rows[i] if coarse else self._whole_patch(self._rows[i]))
                place[i] = first[key]
                for facet, other in zip(kept[first[key]][1], self._rows[i][1], strict=True):
                    wider.setdefault(facet, [facet]).append(other)
            were = list(self._facets)
            for facet, others in wider.items():
                self._facets[facet] = np.unique(np.concatenate([were[k] for k in set(others)]))
            self._rows, index = kept, place[index]
            self._index = {row: i for i, row in enumerate(kept)}
        if len(self._rows) > KINDS_MAX:
            index = np.minimum(index, KINDS_MAX - 1)
            self._rows = self._rows[:KINDS_MAX]
        return index

    def _whole_patch(self, row: tuple[int, tuple[int, ...]]) -> tuple[int, tuple[int, ...]]:
        """The row, or that of the patch when it sees one flat facet of it."""
        if row[0] != int(lib.CR_KIND_PLANAR):
            return row
        return int(lib.CR_KIND_CURVED), (self.curved(self._planes[row[1][0]][1]),)

    def _alike(
        self, row: tuple[int, tuple[int, ...]], offset_m: float, turn: float, coarse: bool
    ) -> Any:
        """What rows that may become one have in common."""
        kind, facets = row
        if kind == int(lib.CR_KIND_MIXED):
            seen = []
            for facet in facets:
                plane, patch, _ = self._planes[facet]
                bins = np.rint(plane / [turn, turn, turn, offset_m]).astype(int).tolist()
                seen.append((patch, *(bins if coarse else ())))
            return kind, tuple(seen)
        if kind == int(lib.CR_KIND_PLANAR) and not coarse:
            return int(lib.CR_KIND_CURVED), self._planes[facets[0]][1]
        return row

    def row(self, index: int) -> tuple[int, tuple[int, ...]]:
        """Kind and facets of a table row."""
        return self._rows[index]

    def __len__(self) -> int:
        return len(self._rows)

    def is_curved(self, facet: int) -> bool:
        """Whether a facet of the image stands for several of the mesh."""
        return self._planes[facet][2] == int(lib.CR_FACET_CURVED)

    def planes_of(self, facets: tuple[int, ...]) -> F64:
        """Planes of facets of the image, (n, 4)."""
        return np.array([self._planes[facet][0] for facet in facets])


class Probes:
    """Points whose exact distances are known, for the question whether planes give these.

    Shapes: points_m (n, m, 3), phi_m (n, m). off_near_m: how far planes may be off nearer than near_m to the surface,
    off_far_m: elsewhere.
    """

    def __init__(
        self, points_m: F64, phi_m: F64, near_m: float, off_near_m: float, off_far_m: float
    ) -> None:
        points, phi = np.ascontiguousarray(points_m), np.ascontiguousarray(phi_m)
        self._kept = points, phi
        self._probes = ffi.new(
            "crb_probes *",
            {
                "points_m": ffi.from_buffer("double[]", points),
                "phi_m": ffi.from_buffer("double[]", phi),
                "width": phi.size // max(1, len(phi)),
                "near_m": near_m,
                "off_near_m": off_near_m,
                "off_far_m": off_far_m,
            },
        )

    def agreeing(self, sign: float, planes: F64, rows: npt.NDArray[np.int64]) -> Any:
        """Those of `rows` at all of whose points planes (k, 4) give the distance; sign: -1 for concave ones."""
        agrees = np.empty(len(rows), np.uint8)
        solid, _kept = _solid(sign, planes)
        wanted = ffi.from_buffer("int64_t[]", np.ascontiguousarray(rows))
        room = ffi.from_buffer("uint8_t[]", agrees)
        lib.crb_planes_agree(solid, self._probes, wanted, len(rows), room)
        return rows[agrees != 0]


def _solid(sign: float, planes: F64) -> tuple[Any, F64]:
    """A crb_planes, and the array it points to, to be held as long as it."""
    held = np.ascontiguousarray(planes)
    return ffi.new("crb_planes *", (ffi.from_buffer("double[]", held), len(held), sign)), held


def distance_from_planes(sign: float, planes: F64, points: F64) -> F64:
    """What the firmware computes in a crease cell. Shapes: planes (k, 4), points (n, 3), result (n,)."""
    places, value = np.ascontiguousarray(points), np.empty(len(points))
    solid, _kept = _solid(sign, planes)
    at, room = (ffi.from_buffer("double[]", array) for array in (places, value))
    lib.crb_distance_from_planes(solid, at, len(places), room)
    return value


def distance_of_kind(kind: Any, facets: npt.NDArray[Any], points: F64) -> F64:
    """Distances from the planes of a record of KINDS. Shapes: points (n, 3), result (n,)."""
    mine = facets[kind["facet"][: kind["count"]]]
    planes = np.column_stack([mine["normal"], mine["offset_m"]]).astype(np.float64)
    return distance_from_planes(
        -1.0 if kind["kind"] == lib.CR_KIND_CONCAVE else 1.0, planes, points
    )
