"""The static object as a two-level sparse voxmap: bricks of signed distances and the surfaces each cell sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from crease.bake.grid import Grid, brick_points, lattice, make_grid, trilinear
from crease.bake.kinds import KINDS_MAX, Kinds, Probes
from crease.bake.layout import BRICK, CELLS_NONE, CELLS_SIDE, KIND_FACETS_MAX
from crease.bake.limits import check_bricks
from crease.bake.planes import BrickPlanes, NearBricks, find_planes
from crease.bake.refine import Coarse, Fine, pack_fine, refine
from crease.bake.surface import Surface
from crease.base.native import lib
from crease.base.progress import Forecast, part_of

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
Tick = Callable[[float], None]

BASE_LEVEL = 3
"""Bricks start with 2^3 cells a side: the voxel."""
FLAT_SHARE = 0.25
"""A brick gets coarser while its samples stay within this share of the tolerance."""
PROBE_SIDE = 5
"""Points a side at which the planes of a crease cell are checked against exact distances."""
PROBE_MARGIN = 0.4
"""How far, in cells, the probes reach beyond the cell: planes that only just matter inside are seen."""
AT_ONCE = 256
"""Bricks whose cells are looked at together: more than that leave the cache."""
BLOCK = 16_384
"""Bricks whose points are in memory at once. Blocks of points start anew as those of threads do (surface.py)."""


@dataclass
class Voxmap:
    """Image records of the static object."""

    grid: Grid
    top: npt.NDArray[np.uint32]
    bricks: npt.NDArray[Any]
    samples: npt.NDArray[np.int16]
    cells: npt.NDArray[np.uint16]
    kinds: npt.NDArray[Any]
    facets: npt.NDArray[Any]
    quantum_m: float
    band_m: float
    crease_m: float
    levels: dict[int, int]
    fine_voxels: dict[int, int]
    kind_counts: dict[str, int]


def choose_levels(phi: F64, tolerance_m: float) -> I32:
    """The coarsest level of each brick that reproduces its base samples. Shapes: phi (n, 9, 9, 9)."""
    level = np.full(len(phi), BASE_LEVEL, np.int32)
    at = lattice(2**BASE_LEVEL + 1)
    open_ = np.arange(len(phi))
    for candidate in range(BASE_LEVEL - 1, -1, -1):
        step = 2 ** (BASE_LEVEL - candidate)
        if len(open_) == 0:
            break
        kept = []
        for part in np.array_split(open_, max(1, len(open_) // 2048)):
            coarse = trilinear(phi[part][:, ::step, ::step, ::step], at)
            error = np.abs(coarse - phi[part].reshape(len(part), -1)).max(axis=1)
            kept.append(part[error <= FLAT_SHARE * tolerance_m])
        open_ = np.concatenate(kept)
        level[open_] = candidate
    return level


class CellSorter:
    """Finds what every cell of the near bricks sees."""

    def __init__(self, surface: Surface, grid: Grid, tolerance_m: float) -> None:
        self.kinds = Kinds(surface)
        self._surface = surface
        self._grid = grid
        self._tolerance_m = tolerance_m
        self._by_patch = np.argsort(surface.facet_patch, kind="stable")
        patches = np.arange(surface.counts["patches"] + 1)
        self._plain_kinds = np.full(
            surface.counts["patches"] + len(surface.facet_patch), -1, np.int32
        )
        self._patch_start = np.searchsorted(surface.facet_patch[self._by_patch], patches)
        self._flat = np.ones(len(surface.facet_patch), bool)

    def sort(self, where: npt.NDArray[np.int64], phi: F64, facet: I32, work: Forecast) -> I32:
        """Kind index of each cell.

        Shapes: where (n, 3) brick indices x, y, z; phi, facet (n, 9, 9, 9); result (n, 8, 8, 8), z, y, x.
        """
        self._flat, self.kinds.bent = flat_facets(self._surface, facet)
        result, hard = self.sort_plain(where, phi, facet)
        work.begin("creases", len(hard))
        if len(hard):
            self._sort_creases(where, hard, result, work.tick)
        return result

    def sort_plain(
        self, where: npt.NDArray[np.int64], phi: F64, facet: I32
    ) -> tuple[I32, npt.NDArray[np.int64]]:
        """Kind index of each cell as its corners tell it, and the cells that take more: (m, 4) brick, z, y, x."""
        shape = (len(where), CELLS_SIDE, CELLS_SIDE, CELLS_SIDE)
        result, mixed, close = (
            np.zeros(shape, np.int32),
            np.zeros(shape, bool),
            np.zeros(shape, bool),
        )
        for first in range(0, len(where), AT_ONCE):
            rows = slice(first, first + AT_ONCE)
            result[rows], mixed[rows], close[rows] = self._plain_cells(phi[rows], facet[rows])
        return result, np.argwhere(close & self._widen(where, mixed))

    def _widen(
        self, where: npt.NDArray[np.int64], mixed: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """The marked cells and their 26 neighbours, across bricks."""
        result = np.zeros_like(mixed)
        marked = np.flatnonzero(mixed.any(axis=(1, 2, 3)))
        wide = np.pad(mixed[marked], ((0, 0), (1, 1), (1, 1), (1, 1)))
        for axis in (1, 2, 3):
            wide = np.pad(wide, [(int(k == axis),) * 2 for k in range(4)])
            low, own, high = (np.take(wide, range(k, k + CELLS_SIDE + 2), axis) for k in range(3))
            wide = low | own | high
        dims = np.array(self._grid.dims, np.int64)
        strides = np.array([1, dims[0], dims[0] * dims[1]])
        keys = where @ strides
        # What of a widened brick lies in the one before it, in itself, and in the one behind it.
        mine = (slice(0, 1), slice(1, -1), slice(-1, None))
        theirs = (slice(-1, None), slice(None), slice(0, 1))
        for z, y, x in np.ndindex(3, 3, 3):
            place = keys[marked] + np.array([x - 1, y - 1, z - 1]) @ strides
            beside = np.minimum(np.searchsorted(keys, place), len(keys) - 1)
            there = np.flatnonzero(keys[beside] == place)
            part = wide[there, mine[z], mine[y], mine[x]]
            result[beside[there], theirs[z], theirs[y], theirs[x]] |= part
        return result

    def _plain_cells(
        self, phi: F64, facet: I32
    ) -> tuple[I32, npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Cells of bricks by their corners: kinds, whether corners disagree on the patch, whether the cell is near."""
        patch = self._surface.facet_patch[facet]
        corners = zip(_corners(phi), _corners(facet), _corners(patch), strict=True)
        value, first_facet, first_patch = next(corners)
        least, lowest = np.abs(value), value
        nearest_facet, nearest_patch = first_facet, first_patch
        one_facet, mixed = np.ones(value.shape, bool), np.zeros(value.shape, bool)
        for value, own_facet, own_patch in corners:
            nearer = np.abs(value) < least
            least, lowest = np.where(nearer, np.abs(value), least), np.minimum(value, lowest)
            nearest_facet = np.where(nearer, own_facet, nearest_facet)
            nearest_patch = np.where(nearer, own_patch, nearest_patch)
            one_facet &= own_facet == first_facet
            mixed |= own_patch != first_patch
        close = (least < self._grid.near_m + 0.87 * self._grid.voxel_m) | (lowest < 0.0)
        keys = np.where(one_facet, nearest_facet, -1 - nearest_patch)
        return self._plain_of(keys), mixed, close

    def _plain_of(self, keys: I32) -> I32:
        """Kinds of cells by their keys (n, 8, 8, 8), new ones numbered brick by brick."""
        place = keys.reshape(-1) + self._surface.counts["patches"]
        kinds = self._plain_kinds[place]
        if (kinds < 0).any():
            fresh = np.flatnonzero(kinds < 0)
            values, first = np.unique(keys.reshape(-1)[fresh], return_index=True)
            for i in np.lexsort((values, fresh[first] // CELLS_SIDE**3)):
                number = self._plain(int(values[i]))
                self._plain_kinds[int(values[i]) + self._surface.counts["patches"]] = number
            kinds = self._plain_kinds[place]
        return np.asarray(kinds.reshape(keys.shape))

    def _facets_of(self, patch: int) -> npt.NDArray[np.int64]:
        return self._by_patch[self._patch_start[patch] : self._patch_start[patch + 1]]

    def _plain(self, key: int) -> int:
        """Kind of a cell that sees one facet (key >= 0) or one patch (key = -1 - patch)."""
        if key < 0 and len(self._facets_of(-1 - key)) == 1:
            key = int(self._facets_of(-1 - key)[0])
        if key >= 0 and not self._flat[key]:
            key = -1 - int(self._surface.facet_patch[key])
        if key >= 0:
            return self.kinds.index(int(lib.CR_KIND_PLANAR), (self.kinds.planar(key),))
        return self.kinds.index(int(lib.CR_KIND_CURVED), (self.kinds.curved(-1 - key),))

    def _sort_creases(
        self, where: npt.NDArray[np.int64], hard: npt.NDArray[np.int64], result: I32, tick: Tick
    ) -> None:
        """Kinds of the cells `hard` (m, 4: brick, z, y, x), by exact distances at probes in each."""
        brick, cell = hard[:, 0], hard[:, 1:]
        low = where[brick] + cell[:, ::-1] / CELLS_SIDE
        for part in np.array_split(np.arange(len(cell)), max(1, len(cell) // 4096)):
            kinds = self._judge(*self._probes(low[part]))
            result[brick[part], cell[part, 0], cell[part, 1], cell[part, 2]] = kinds
            tick(float(part[-1] + 1) / len(cell))

    def missed_by_planes(
        self, where: npt.NDArray[np.int64], hard: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.bool_]:
        """Whether no planes describe a cell, of the cells `hard` (m, 4: brick, z, y, x)."""
        kinds = self._judge(*self._probes(where[hard[:, 0]] + hard[:, :0:-1] / CELLS_SIDE))
        exact = int(lib.CR_KIND_CONVEX), int(lib.CR_KIND_CONCAVE)
        return np.array([self.kinds.row(int(kind))[0] not in exact for kind in kinds])

    def _probes(self, low: F64) -> tuple[F64, F64, I32]:
        """Probes of cells, distances, facets there. Shapes: low (n, 3), in bricks; result (n, m, 3), (n, m) twice."""
        probe = lattice(PROBE_SIDE, -PROBE_MARGIN, 1 + PROBE_MARGIN) / CELLS_SIDE
        points = self._grid.origin_m + (low[:, None, :] + probe[None]) * self._grid.brick_m
        phi, triangle = self._surface.signed_distance(points)
        facet = self._surface.facet_of[triangle].reshape(len(low), -1)
        return points, phi.reshape(len(low), -1), facet

    def _judge(self, points: F64, phi: F64, facet: I32) -> I32:
        """Kinds of crease cells from exact probes. Shapes: points (n, m, 3), phi and facet (n, m)."""
        groups: dict[tuple[int, ...], list[int]] = {}
        for i, key in enumerate(_sets(facet)):
            groups.setdefault(key, []).append(i)
        kinds = np.zeros(len(points), np.int32)
        probes = Probes(
            points, phi, self._grid.near_m, 0.5 * self._tolerance_m, 0.5 * self._grid.voxel_m
        )
        for key, cells in groups.items():
            self._judge_set(key, np.array(cells, np.int64), probes, kinds)
        return kinds

    def _judge_set(
        self,
        facets: tuple[int, ...],
        left: npt.NDArray[np.int64],
        probes: Probes,
        kinds: I32,
    ) -> None:
        """Write the kinds of the cells `left`, which see these facets."""
        if len(facets) == 1:
            kinds[left] = self._plain(facets[0])
            return
        patches = self._surface.facet_patch[list(facets)]
        if (patches == patches[0]).all():
            kinds[left] = self._plain(-1 - int(patches[0]))
            return
        if len(facets) <= KIND_FACETS_MAX:
            planes = self._surface.facet_plane[list(facets)]
            rows = tuple(self.kinds.planar(f) for f in facets)
            for kind, sign in ((lib.CR_KIND_CONVEX, 1.0), (lib.CR_KIND_CONCAVE, -1.0)):
                good = probes.agreeing(sign, planes, left)
                if len(good):
                    kinds[good] = self.kinds.index(int(kind), rows)
                    left = left[~np.isin(left, good)]
        if len(left):
            kinds[left] = self.kinds.index(
                int(lib.CR_KIND_MIXED), self._mixed(np.array(facets), patches)
            )

    def _mixed(self, facets: npt.NDArray[np.int64], patches: I32) -> tuple[int, ...]:
        rows = []
        for patch in np.unique(patches)[:KIND_FACETS_MAX]:
            mine = facets[patches == patch]
            rows.append(
                self.kinds.planar(int(mine[0]))
                if len(mine) == 1 and self._flat[mine[0]]
                else self.kinds.local(mine, int(patch))
            )
        return tuple(rows)


def flat_facets(
    surface: Surface, facet: I32
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Facets whose distances are those of planes: alone in their patch, at a crease, or all that some brick sees.

    The others are facets of a round surface, and are felt as the patch in all of their cells: where some were planes,
    the force would jump as samples come from the ones to the others. So are those that cells beside other patches see,
    deep inside too, with distances of planes, and where no facet of a patch is as wide as two samples are apart all
    planes: second result.
    Shapes: facet (bricks, 9, 9, 9).
    """
    triangles, patch = surface.mesh.triangles, surface.patch_of[:, None]
    low = np.full(surface.counts["vertices"], surface.counts["patches"])
    high = np.full(surface.counts["vertices"], -1)
    np.minimum.at(low, triangles, patch)
    np.maximum.at(high, triangles, patch)
    flat = np.asarray(np.bincount(surface.facet_patch)[surface.facet_patch] == 1)
    seen = facet.reshape(len(facet), -1)
    flat[seen[(seen == seen[:, :1]).all(axis=1), 0]] = True
    flat[surface.facet_of[(low != high)[triangles].any(axis=1)]] = True
    return flat, ~flat | surface.fine[surface.facet_patch]


def _sets(facet: I32) -> list[tuple[int, ...]]:
    return [tuple(sorted(set(row))) for row in facet.tolist()]


def _corners(samples: npt.NDArray[Any]) -> Iterator[npt.NDArray[Any]]:
    """Values at each of the eight corners of every cell of bricks, (n, 9, 9, 9) to (n, 8, 8, 8), x fastest."""
    n = CELLS_SIDE
    for z, y, x in np.ndindex(2, 2, 2):
        yield samples[:, z : z + n, y : y + n, x : x + n]


def near_bricks(surface: Surface, grid: Grid) -> npt.NDArray[np.bool_]:
    """Bricks that hold distances: near the surface, and inside as far as depth_m. Shape z, y, x."""
    near = surface.mark_bricks(grid.origin_m, grid.brick_m, grid.dims, grid.reach_m)
    deep = surface.mark_bricks(grid.origin_m, grid.brick_m, grid.dims, grid.depth_m) & ~near
    where = np.argwhere(deep)
    if len(where):
        middle = brick_points(grid, where[:, ::-1], np.full((1, 3), 0.5)).reshape(-1, 3)
        phi, _ = surface.signed_distance(middle)
        near[tuple(where[phi.reshape(-1) < 0.0].T)] = True
    return np.asarray(near)


def far_bricks(
    surface: Surface, grid: Grid, near: npt.NDArray[np.bool_], quantum_m: float
) -> npt.NDArray[np.uint32]:
    """Top entries of far bricks: side and lower bound of the distance. Shape as `near`, z, y, x."""
    touched = surface.mark_bricks(grid.origin_m, grid.brick_m, grid.dims, 0.0)
    apart = ndimage.distance_transform_edt(~touched)
    bound = np.maximum(grid.reach_m, (apart - math.sqrt(3.0)) * grid.brick_m * (1 - 1e-6))
    entry = np.minimum(bound * (1 - 1e-6) / quantum_m, float(lib.CR_TOP_BOUND)).astype(np.uint32)
    entry |= np.uint32(lib.CR_TOP_FAR)
    label, count = ndimage.label(~near)
    spots = ndimage.find_objects(label)
    for i in range(count):
        part = label[spots[i]] == i + 1
        z, y, x = (int(v) for v in np.argwhere(part)[0])
        start = [s.start for s in spots[i]]
        index = np.array([[x + start[2], y + start[1], z + start[0]]], np.int64)
        phi, _ = surface.signed_distance(brick_points(grid, index, np.full((1, 3), 0.5)))
        if phi[0] < 0:
            deepest = np.uint32(min(grid.depth_m * (1 - 1e-6) / quantum_m, float(lib.CR_TOP_BOUND)))
            inside = entry[spots[i]][part]
            bound_of = np.maximum(inside & np.uint32(lib.CR_TOP_BOUND), deepest)
            entry[spots[i]][part] = bound_of | np.uint32(lib.CR_TOP_FAR | lib.CR_TOP_INSIDE)
    return np.asarray(entry)


def make_voxmap(
    surface: Surface,
    voxel_m: float,
    near_m: float,
    tolerance_m: float,
    work: Forecast,
    memory_max: int,
    depth_max_m: float | None = None,
) -> Voxmap:
    """The whole voxmap: near_m is the distance up to which a sample of the tool can be covered.

    depth_max_m: how far the tool goes in; bricks wholly deeper have eight samples, and no cells where planes hold.
    Errors: MeshError when it would take more than memory_max bytes.
    """
    grid = make_grid(surface, voxel_m, near_m)
    near = near_bricks(surface, grid)
    where = np.argwhere(near)[:, ::-1]
    whole = float(np.prod(grid.dims))
    check_bricks(surface.mesh, voxel_m, near_m, len(where), whole, memory_max)
    work.begin("distances", len(where))
    phi, facet = base_samples(surface, grid, where, work.tick)
    sorter = CellSorter(surface, grid, tolerance_m)
    cells = sorter.sort(where, phi, facet, work)
    work.begin("planes", len(where))
    band = math.sqrt(3.0) * grid.brick_m + 1.1 * grid.depth_m
    quantum = float(np.float32(band / 32767))
    bricks_near = NearBricks(
        where,
        phi,
        cells,
        lambda bricks, side: brick_points(grid, bricks, lattice(side)),
        lambda points: surface.signed_distance(points)[0],
    )
    planes = find_planes(bricks_near, sorter.kinds, quantum)
    if len(sorter.kinds) > KINDS_MAX:
        cells, planes = _merged(sorter.kinds, cells, planes, voxel_m)
    kinds, facets = sorter.kinds.records(voxel_m)
    level = choose_levels(phi, tolerance_m)
    if depth_max_m is not None:
        deep = phi.max(axis=(1, 2, 3)) < -(depth_max_m + near_m)
        level[deep] = 0
        by_planes = deep & (planes.least != 0)
        cells[by_planes] = planes.least[by_planes, None, None, None]
    exact = np.isin(kinds["kind"], [lib.CR_KIND_CONVEX, lib.CR_KIND_CONCAVE])
    open_ = np.flatnonzero(level == BASE_LEVEL)
    work.begin("checking", len(open_))
    fine = refine(
        Coarse(grid, where, phi, ~exact[cells], open_),
        lambda points: surface.signed_distance(points)[0],
        tolerance_m,
        work.tick,
        lambda count: work.begin("refining", count),
    )
    work.begin("packing", len(where) + len(fine.brick))
    top = far_bricks(surface, grid, near, quantum)
    top[near] = np.arange(len(where), dtype=np.uint32)
    bricks, samples, tables = _pack_bricks(where, phi, fine, level, cells, planes, kinds, quantum)
    names = {
        int(getattr(lib, f"CR_KIND_{n}")): n.lower()
        for n in ("PLANAR", "CURVED", "CONVEX", "CONCAVE", "MIXED")
    }
    used = np.bincount(kinds["kind"][cells.reshape(-1)], minlength=6)
    return Voxmap(
        grid,
        top.reshape(-1),
        bricks,
        samples,
        tables,
        kinds,
        facets,
        quantum,
        band,
        near_m + 0.5 * grid.voxel_m,
        {int(k): int((level == k).sum()) for k in np.unique(level)},
        {2**k: int((fine.level == k).sum()) for k in np.unique(fine.level).tolist()},
        {name: int(used[key]) for key, name in names.items()},
    )


def _merged(
    kinds: Kinds, cells: I32, planes: BrickPlanes, voxel_m: float
) -> tuple[I32, BrickPlanes]:
    """Cells and planes of bricks with fewer kinds; a brick whose kind has lost its planes has none."""
    place = kinds.merged(voxel_m)
    plane_kinds = (lib.CR_KIND_PLANAR, lib.CR_KIND_CONVEX, lib.CR_KIND_CONCAVE)
    has_planes = np.array([kinds.row(i)[0] in plane_kinds for i in range(len(kinds))])
    both = has_planes[place[planes.least]] & has_planes[place[planes.most]]
    least, most = (np.where(both, place[k], 0) for k in (planes.least, planes.most))
    return place[cells], BrickPlanes(least.astype(np.int32), most.astype(np.int32))


def base_samples(
    surface: Surface, grid: Grid, where: npt.NDArray[np.int64], tick: Tick
) -> tuple[F64, I32]:
    """Distances and nearest facets at the corners of the voxels of bricks, (n, 9, 9, 9) each."""
    base, shape = lattice(2**BASE_LEVEL + 1), (2**BASE_LEVEL + 1,) * 3
    phi, facet = np.empty((len(where), *shape)), np.empty((len(where), *shape), np.int32)
    for first in range(0, len(where), BLOCK):
        rows = slice(first, first + BLOCK)
        share, done = min(1.0, BLOCK / len(where)), first / len(where)
        distance, triangle = surface.signed_distance(
            brick_points(grid, where[rows], base), part_of(tick, done, share)
        )
        phi[rows] = distance.reshape(-1, *shape)
        facet[rows] = surface.facet_of[triangle].reshape(-1, *shape)
    return phi, facet


def _pack_bricks(
    where: npt.NDArray[np.int64],
    phi: F64,
    fine: Fine,
    level: I32,
    cells: I32,
    planes: BrickPlanes,
    kinds: npt.NDArray[Any],
    quantum_m: float,
) -> tuple[npt.NDArray[Any], npt.NDArray[np.int16], npt.NDArray[np.uint16]]:
    creased = np.isin(kinds["kind"], [lib.CR_KIND_CONVEX, lib.CR_KIND_CONCAVE])
    bricks = np.zeros(len(phi), BRICK)
    bricks["side"] = 2**level
    bricks["samples"], bricks["fine"], samples = _pack_samples(where, phi, fine, level, quantum_m)
    bricks["cells"], tables = _pack_cells(cells)
    of_cells = np.where(bricks["cells"] == CELLS_NONE, cells[:, 0, 0, 0], 0)
    bricks["kind"] = np.where(planes.least != 0, planes.least, of_cells)
    bricks["planes"] = planes.most
    bricks["creased"] = creased[cells].any(axis=(1, 2, 3))
    return bricks, samples, tables


def _pack_samples(
    where: npt.NDArray[np.int64], phi: F64, fine: Fine, level: I32, quantum_m: float
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.bool_], npt.NDArray[np.int16]]:
    """Where the samples of each brick are, whether they are fine, and all of them.

    Fine bricks come first: their blocks begin at lines of memory, without gaps between. Of the others equal ones share
    their samples, and one above another its lowest layer with the highest of that.
    """
    is_fine = np.zeros(len(phi), bool)
    is_fine[fine.brick] = True
    place = np.zeros(len(phi), np.uint32)
    parts: list[npt.NDArray[np.int16]] = []
    seen: dict[bytes, int] = {}
    at = 0
    columns = np.lexsort((where[:, 2], where[:, 1], where[:, 0]))
    for i in [*np.flatnonzero(is_fine).tolist(), *columns[~is_fine[columns]].tolist()]:
        step = 2 ** (BASE_LEVEL - int(level[i]))
        values = phi[i, ::step, ::step, ::step]
        data = np.clip(np.rint(values / quantum_m), -32767, 32767).astype(np.int16).reshape(-1)
        if is_fine[i]:
            data = pack_fine(data, fine, fine.of_brick(i), quantum_m)
        layer = (2 ** int(level[i]) + 1) ** 2
        joins = parts and not is_fine[i] and np.array_equal(parts[-1][-layer:], data[:layer])
        begin = at - layer if joins else at
        place[i] = begin if is_fine[i] else seen.setdefault(data.tobytes(), begin)
        if place[i] == begin:
            parts.append(data[layer:] if joins else data)
            at += len(parts[-1])
    return place, is_fine, np.concatenate(parts)


def _pack_cells(cells: I32) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint16]]:
    """Where the cell table of each brick is, CELLS_NONE for one kind all over, and all tables: equal ones once."""
    flat = cells.reshape(len(cells), -1)
    place = np.full(len(cells), CELLS_NONE, np.uint32)
    seen: dict[bytes, int] = {}
    tables: list[npt.NDArray[np.uint16]] = []
    for i in np.flatnonzero((flat != flat[:, :1]).any(axis=1)).tolist():
        table = flat[i].astype(np.uint16)
        place[i] = seen.setdefault(table.tobytes(), len(tables) * CELLS_SIDE**3)
        if place[i] == len(tables) * CELLS_SIDE**3:
            tables.append(table)
    return place, np.concatenate(tables) if tables else np.zeros(0, np.uint16)
