"""The static surface as the bake sees it: facets, patches, creases and exact distances (C, host/native/surface/)."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from crease.base.errors import MeshError
from crease.base.native import ffi, lib
from crease.mesh import topology
from crease.mesh.arrange import Winding
from crease.mesh.mesh import Mesh

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

THREADS = 2
_CHUNK = 16384
ROUNDING = 4e-7
"""Of places in single precision, as a share of the largest: what is thinner has no face of its own."""
SHARED = 0.5
"""Border of narrow patches with each other, as a share of that with others, from which on they are one: 0.87 of the
sides of a pyramid, 0.04 of the chamfers of a cube 40 times as wide."""
ONE_SIDED = 0.95
"""How much of the area of a patch faces the way of its mean normal, if it is a plane: 0.71 of a chamfer of 45 degrees
round a disc or a hole, 0.9998 of a face whose triangles are off by one degree."""
ALONG = 0.5
"""Mean cosine of the angles round an isle from which on it faces the way of what is round it: the end of a pin and its
side, at 0, are two ways out."""
ISLAND = 2.0 / 3.0
"""Share of its border from which on a narrow patch is part of what it borders there: a chamfer has half of it on either
side, one round a hole as wide as its radius two thirds."""
SLENDER = 0.05
"""Width of an isle by its border below which it is a piece of a bevel or crest, which parts what lies on either side of
it: 0.096 of a triangle with equal sides, 0.03 of those on the crest of a thread."""
SIDEWAYS = 1e-9
"""Part of a distance by which it is longer than the height above the nearest triangle, where its rim is nearest."""


def _ptr(kind: str, array: npt.NDArray[Any]) -> Any:
    return ffi.from_buffer(kind, array)


@dataclass(frozen=True)
class Creases:
    """Sharp edges. Shapes: ends_m (n, 2, 3), patch (n, 2), convex (n,), angle_rad (n,)."""

    ends_m: F64
    patch: I32
    convex: npt.NDArray[np.bool_]
    angle_rad: F64


@dataclass(frozen=True)
class Surface:
    """A closed mesh with its features.

    Shapes: facet_of, patch_of (triangles,); facet_plane (facets, 4) unit normal and offset; facet_patch,
    facet_area_m2 (facets,).
    """

    handle: Any = field(repr=False)
    mesh: Mesh = field(repr=False)
    counts: dict[str, int]
    facet_of: I32
    patch_of: I32
    facet_plane: F64
    facet_patch: I32
    facet_area_m2: F64
    creases: Creases
    doubtful: npt.NDArray[np.bool_] = field(repr=False)
    """Triangles (n,) with a corner where the surface touches itself: there its normals may not tell what is inside."""
    fine: npt.NDArray[np.bool_] = field(repr=False)
    """Patches (n,) of several facets, all of them narrower than two samples are apart; none before join_narrow."""
    winding: Winding | None = field(repr=False)
    """Tells inside from outside next to doubtful triangles; None where there are none."""

    def signed_distance(
        self, points_m: F64, tick: Callable[[float], None] | None = None
    ) -> tuple[F64, I32]:
        """Exact signed distance, negative inside, and nearest triangle of each point.

        The sign is that of the nearest triangle, edge or corner, by angle-weighted normals; where the surface touches
        itself, by the winding number.

        Shapes: points_m (n, 3), neighbouring points close together for speed.
        """
        points = np.ascontiguousarray(points_m, np.float64).reshape(-1, 3)
        phi = np.empty(len(points))
        triangle = np.empty(len(points), np.int32)

        def work(first: int) -> None:
            end = min(first + _CHUNK, len(points))
            lib.crb_signed_distance(
                self.handle,
                _ptr("double[]", points[first:end]),
                end - first,
                _ptr("double[]", phi[first:end]),
                _ptr("int32_t[]", triangle[first:end]),
            )

        starts = range(0, len(points), _CHUNK)
        if len(starts) == 1:
            work(0)
            return self._settled(points, phi, triangle), triangle
        with ThreadPoolExecutor(THREADS) as pool:
            for done, _ in enumerate(pool.map(work, starts)):
                if tick is not None:
                    tick((done + 1) / len(starts))
        return self._settled(points, phi, triangle), triangle

    def _settled(self, points: F64, phi: F64, triangle: I32) -> F64:
        """The distances, with the sign by the winding number where a doubtful edge or corner is nearest."""
        if self.winding is None:
            return phi
        asked = np.flatnonzero(self.doubtful[triangle])
        corners = self.mesh.vertices_m[self.mesh.triangles[triangle[asked]]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        height = np.abs(((points[asked] - corners[:, 0]) * normal).sum(axis=1))
        far = np.abs(phi[asked]) * np.linalg.norm(normal, axis=1)
        asked = asked[height < (1.0 - SIDEWAYS) * far]
        inside = self.winding.at(points[asked]) > 0.5
        phi[asked] = np.where(inside, -1.0, 1.0) * np.abs(phi[asked])
        return phi

    def mark_bricks(
        self, origin_m: F64, brick_m: float, dims: tuple[int, int, int], reach_m: float
    ) -> npt.NDArray[np.bool_]:
        """Bricks that the surface comes within reach_m of. Shapes: dims x, y, z; result (z, y, x)."""
        flags = np.zeros((dims[2], dims[1], dims[0]), np.uint8)
        lib.crb_mark_bricks(
            self.handle,
            _ptr("double[]", np.ascontiguousarray(origin_m)),
            brick_m,
            list(dims),
            reach_m,
            _ptr("uint8_t[]", flags.reshape(-1)),
        )
        return flags.astype(bool)


def plane_tolerance_m(mesh: Mesh) -> float:
    """How far vertices of one planar facet may lie from its plane: rounding of single-precision files."""
    return ROUNDING * max(mesh_diagonal_m(mesh), float(np.abs(mesh.vertices_m).max()))


def mesh_diagonal_m(mesh: Mesh) -> float:
    """The diagonal of a mesh's box."""
    return float(np.linalg.norm(np.ptp(mesh.vertices_m, axis=0)))


def make_surface(mesh: Mesh, crease_angle_deg: float) -> Surface:
    """Features and search tree of a mesh.   Errors: MeshError when the mesh is not closed."""
    vertices = np.ascontiguousarray(mesh.vertices_m, np.float64)
    triangles = np.ascontiguousarray(mesh.triangles, np.int32)
    raw = lib.crb_mesh_new(
        _ptr("double[]", vertices),
        len(vertices),
        _ptr("int32_t[]", triangles),
        len(triangles),
        math.radians(crease_angle_deg),
        plane_tolerance_m(mesh),
        ROUNDING * mesh_diagonal_m(mesh),
    )
    if raw == ffi.NULL:
        raise MeshError(f"{mesh.source}: not enough memory for {len(triangles):,} triangles")
    handle = ffi.gc(raw, lib.crb_mesh_free)
    counts = ffi.new("crb_counts *")
    lib.crb_mesh_counts(handle, counts)
    facets, creases = counts.facets, counts.convex_edges + counts.concave_edges
    facet_of, patch_of = np.empty(len(triangles), np.int32), np.empty(len(triangles), np.int32)
    plane, patch = np.empty((facets, 4)), np.empty(facets, np.int32)
    area = np.empty(facets)
    lib.crb_mesh_features(
        handle,
        _ptr("int32_t[]", facet_of),
        _ptr("int32_t[]", patch_of),
        _ptr("double[]", plane),
        _ptr("int32_t[]", patch),
        _ptr("double[]", area),
    )
    ends, sides = np.empty((creases, 2, 3)), np.empty((creases, 2), np.int32)
    convex, angle = np.empty(creases, np.uint8), np.empty(creases)
    lib.crb_mesh_creases(
        handle,
        _ptr("double[]", ends),
        _ptr("int32_t[]", sides),
        _ptr("uint8_t[]", convex),
        _ptr("double[]", angle),
    )
    names = "triangles vertices facets patches smooth_edges convex_edges concave_edges open_edges"
    doubtful = topology.touching(triangles, len(vertices))
    return Surface(
        handle,
        mesh,
        {name: int(getattr(counts, name)) for name in names.split()},
        facet_of,
        patch_of,
        plane,
        patch,
        area,
        Creases(ends, sides, convex.astype(bool), angle),
        doubtful,
        np.zeros(counts.patches, bool),
        Winding(vertices, triangles) if doubtful.any() else None,
    )


def flatten(surface: Surface, within_m: float) -> Surface:
    """The same, each patch within within_m of one plane being one facet: the noise of a flat face is no shape."""
    patches, of = surface.counts["patches"], surface.patch_of
    corners = surface.mesh.vertices_m[surface.mesh.triangles]
    area_m2 = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack([_sums(of, area_m2[:, k], patches) for k in range(3)], axis=1)
    length_m2 = np.linalg.norm(sums, axis=1)
    normal = sums / np.maximum(length_m2, 1e-300)[:, None]
    height_m = (corners * normal[of, None]).sum(axis=2)
    weight_m2 = np.linalg.norm(area_m2, axis=1)
    total_m2 = _sums(of, weight_m2, patches)
    middle_m = _sums(of, weight_m2 * height_m.mean(axis=1), patches)
    middle_m /= np.maximum(total_m2, 1e-300)
    off_m = np.zeros(patches)
    np.maximum.at(off_m, of, np.abs(height_m - middle_m[of, None]).max(axis=1))
    patch = surface.facet_patch
    one_sided = length_m2 > ONE_SIDED * total_m2
    flat = (np.bincount(patch, minlength=patches) > 1) & (off_m < within_m) & one_sided
    if not flat.any():
        return surface
    first = np.full(patches, len(patch))
    np.minimum.at(first, patch, np.arange(len(patch)))
    stands_for = np.where(flat[patch], first[patch], np.arange(len(patch)))
    kept, facet = np.unique(stands_for, return_inverse=True)
    plane = surface.facet_plane[kept]
    flattened = flat[patch[kept]]
    plane[flattened] = np.column_stack([normal, middle_m])[patch[kept[flattened]]]
    return replace(
        surface,
        counts=surface.counts | {"facets": len(kept)},
        facet_of=facet[surface.facet_of].astype(np.int32),
        facet_plane=plane,
        facet_patch=patch[kept],
        facet_area_m2=_sums(facet, surface.facet_area_m2, len(kept)),
    )


def join_narrow(surface: Surface, least_m: float) -> Surface:
    """The same, patches narrower than least_m being one with their like, or with what they lie in.

    How wide a patch is: twice its area by its border. What is narrower than the samples of a tool are apart has no
    sides for it: those that border each other more than others are one, and one that borders another by ISLAND of its
    border is part of that. Creases inside of what is joined are smooth edges. A chamfer, which borders wide patches on
    either side, stays.
    """
    creases = surface.creases
    area_m2 = _sums(surface.facet_patch, surface.facet_area_m2, surface.counts["patches"])
    borders = _Borders(creases, area_m2, least_m)
    alike = joined = borders.alike()
    while (found := borders.with_islands(joined)).max() < joined.max():
        joined = found
    ends = joined[creases.patch]
    own = creases.patch[:, 0] == creases.patch[:, 1]
    alone = np.bincount(alike)[alike[creases.patch[:, 0]]] == 1
    outside = (ends[:, 0] != ends[:, 1]) | (own & alone)
    counts = surface.counts | {
        "patches": int(joined.max()) + 1,
        "smooth_edges": surface.counts["smooth_edges"] + int(np.count_nonzero(~outside)),
        "convex_edges": int(np.count_nonzero(creases.convex[outside])),
        "concave_edges": int(np.count_nonzero(~creases.convex[outside])),
    }
    made = replace(
        surface,
        counts=counts,
        patch_of=joined[surface.patch_of],
        facet_patch=joined[surface.facet_patch],
        creases=Creases(
            creases.ends_m[outside],
            ends[outside],
            creases.convex[outside],
            creases.angle_rad[outside],
        ),
    )
    return replace(made, fine=_patches_of_narrow_facets(made, 2.0 * least_m))


class _Borders:
    """How long the patches of a surface border each other, and which of them are narrower than least_m."""

    def __init__(self, creases: Creases, area_m2: F64, least_m: float) -> None:
        self._pairs, self._angle_rad = creases.patch, creases.angle_rad
        self._area_m2, self._least_m = area_m2, least_m
        length_m = np.linalg.norm(creases.ends_m[:, 1] - creases.ends_m[:, 0], axis=1)
        self._length_m = np.where(self._pairs[:, 0] == self._pairs[:, 1], 0.0, length_m)
        self._border_m = _sums(self._pairs.T, self._length_m, len(area_m2))
        self.narrow = 2.0 * area_m2 < least_m * self._border_m

    def alike(self) -> I32:
        """The patches, narrow ones that border each other more than others being one."""
        first, second = self._pairs.T
        inside = self.narrow[first] & self.narrow[second]
        sets, found = _connected(self._pairs[inside], len(self.narrow))
        shared_m = _sums(found[first[inside]], self._length_m[inside], sets)
        others_m = _sums(found, self._border_m, sets) - 2.0 * shared_m
        inside &= (shared_m > SHARED * others_m)[found[first]]
        return _connected(self._pairs[inside], len(self.narrow))[1]

    def with_islands(self, joined: I32) -> I32:
        """The patches that are `joined` already, narrow ones being one with what they lie in."""
        pairs = np.sort(joined[self._pairs], axis=1)
        apart = pairs[:, 0] != pairs[:, 1]
        count = int(joined.max()) + 1
        area_m2 = _sums(joined, self._area_m2, count)
        border_m = _sums(pairs[apart].T, self._length_m[apart], count)
        isle = (2.0 * area_m2 < self._least_m * border_m) & (2.0 * area_m2 > SLENDER * border_m**2)
        keys, of = np.unique(pairs[apart], axis=0, return_inverse=True)
        length_m, cosine = self._length_m[apart], np.cos(self._angle_rad[apart])
        shared_m = _sums(of.reshape(-1), length_m, len(keys))
        along = _sums(of.reshape(-1), length_m * cosine, len(keys)) > ALONG * shared_m
        inside = [isle[p] & along & (shared_m > ISLAND * border_m[p]) for p in keys.T]
        return _connected(keys[inside[0] | inside[1]], count)[1][joined]


def _patches_of_narrow_facets(surface: Surface, least_m: float) -> npt.NDArray[np.bool_]:
    """Patches of several facets that are all narrower than least_m: twice the area of each by its border."""
    triangles, facets = surface.mesh.triangles, len(surface.facet_patch)
    ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs = np.lexsort((ends[:, 1], ends[:, 0])).reshape(-1, 2)  # the mesh is closed
    sides = np.repeat(surface.facet_of, 3)[pairs]
    apart = sides[:, 0] != sides[:, 1]
    a_m, b_m = surface.mesh.vertices_m[ends[pairs[apart, 0]]].swapaxes(0, 1)
    length_m = np.linalg.norm(b_m - a_m, axis=1)
    border_m = sum(np.bincount(side, length_m, facets) for side in sides[apart].T)
    wide = 2.0 * surface.facet_area_m2 >= least_m * border_m
    several = np.bincount(surface.facet_patch, minlength=surface.counts["patches"]) > 1
    several[surface.facet_patch[wide]] = False
    return np.asarray(several)


def _connected(pairs: I32, count: int) -> tuple[int, I32]:
    """Sets of what the pairs (n, 2) connect, of `count`, and the set of each, in order."""
    beside = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
    sets, found = csgraph.connected_components(beside, directed=False)
    return int(sets), found.astype(np.int32)


def _sums(of: npt.NDArray[Any], values: F64, count: int) -> F64:
    """Sums of values (n,) by what each is of, (n,), or both of (2, n): (count,)."""
    rows = [np.bincount(row, values, count) for row in np.atleast_2d(of)]
    return np.asarray(np.sum(rows, axis=0), np.float64)
