"""Random closed solids of hand size, and awkward triangulations of their surfaces.

Everything in metres, the static object about 40 to 80 mm across and the tool about half of that, so that one set of
tolerances serves: other sizes are made by scaling what is baked (`pool`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import manifold3d
import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Rng = np.random.Generator
Solid = Any
"""A manifold3d.Manifold."""

STATIC_M, TOOL_M = 0.03, 0.014
"""Half size of the static object, and of the tool."""


def hull(rng: Rng, half_m: float) -> Solid:
    """Convex hull of 5 to 30 random points."""
    points = rng.normal(size=(int(rng.integers(5, 31)), 3)) * rng.uniform(0.35, 0.8, 3)
    points *= half_m / np.abs(points).max()
    return manifold3d.Manifold.hull_points(points)


def primitive(rng: Rng, half_m: float) -> Solid:
    """A box, ball, cylinder or cone, turned at random or upright."""
    size = half_m * rng.uniform(0.4, 1.0, 3)
    kind = rng.integers(4)
    if kind == 0:
        made = manifold3d.Manifold.cube(tuple(2 * size), True)
    elif kind == 1:
        made = manifold3d.Manifold.sphere(float(size[0]), int(rng.choice([12, 24, 48])))
    else:
        top = float(size[1]) if kind == 2 else 0.3 * float(size[1])
        segments = int(rng.choice([3, 6, 16, 40]))
        made = manifold3d.Manifold.cylinder(2 * float(size[0]), float(size[1]), top, segments, True)
    turn = rng.uniform(-180, 180, 3) if rng.random() < 0.5 else 90.0 * rng.integers(0, 4, 3)
    return made.rotate(tuple(turn.astype(float)))


def boolean(rng: Rng, half_m: float) -> Solid:
    """Two to four primitives joined and cut: convex and concave creases, mixed corners, thin remains."""
    made = primitive(rng, half_m)
    for _ in range(int(rng.integers(1, 4))):
        other = primitive(rng, 0.7 * half_m).translate(tuple(half_m * rng.uniform(-0.8, 0.8, 3)))
        made = made - other if rng.random() < 0.4 else made + other
    return made


def plate(rng: Rng, half_m: float) -> Solid:
    """A plate or a bar, thin against the tool."""
    size = half_m * np.array([1.0, rng.uniform(0.1, 1.0), rng.uniform(0.04, 0.15)])
    return manifold3d.Manifold.cube(tuple(2 * size), True)


def needle(rng: Rng, half_m: float) -> Solid:
    """A long thin pyramid."""
    thin = half_m * float(rng.uniform(0.08, 0.2))
    return manifold3d.Manifold.cylinder(2 * half_m, thin, 0.05 * thin, 4, True)


STATICS: dict[str, Callable[[Rng, float], Solid]] = {
    "hull": hull,
    "boolean": boolean,
    "plate": plate,
}
TOOLS: dict[str, Callable[[Rng, float], Solid]] = {
    "hull": hull,
    "boolean": boolean,
    "needle": needle,
}
CONVEX = frozenset({"hull", "plate", "needle"})


def surface_of(solid: Solid) -> tuple[F64, I64]:
    """Vertices (n, 3) in m and triangles (m, 3)."""
    mesh = solid.to_mesh64()
    return (
        np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
        np.array(mesh.tri_verts).astype(np.int64),
    )


def make_solid(rng: Rng, makers: dict[str, Callable[[Rng, float], Solid]], half_m: float,
               kind: str) -> Solid:  # fmt: skip
    """One connected solid of a kind: the largest piece of what the maker gives.

    A maker may cut everything away; then it is asked again.
    """
    for _ in range(20):
        pieces = makers[kind](rng, half_m).simplify(1e-6).decompose()
        best = max(pieces, key=lambda p: p.volume(), default=None)
        if best is not None and best.volume() > (0.1 * half_m) ** 3:
            # Triangles coplanar to rounding are one face to the exact contact too.
            return best.as_original().simplify(1e-6)
    return manifold3d.Manifold.cube((half_m,) * 3, True)


def split_edges(rng: Rng, vertices: F64, triangles: I64, count: int) -> tuple[F64, I64]:
    """The same surface with `count` edges split near one end: slivers, and coplanar triangles."""
    points, faces = list(vertices), [tuple(t) for t in triangles.tolist()]
    for _ in range(count):
        a, b, _ = faces[int(rng.integers(len(faces)))]
        share = float(rng.choice([0.5, 0.1, 1e-2, 1e-3]))
        points.append((1 - share) * points[a] + share * points[b])
        faces = _split(faces, a, b, len(points) - 1)
    return np.array(points), np.array(faces, dtype=np.int64)


def _split(
    faces: list[tuple[int, int, int]], a: int, b: int, middle: int
) -> list[tuple[int, int, int]]:
    """Both triangles at edge a-b, in two each."""
    out = []
    for face in faces:
        if a in face and b in face:
            i = next(k for k in range(3) if {face[k], face[(k + 1) % 3]} == {a, b})
            p, q, r = face[i], face[(i + 1) % 3], face[(i + 2) % 3]
            out += [(p, middle, r), (middle, q, r)]
        else:
            out.append(face)
    return out


def degenerate(rng: Rng, vertices: F64, triangles: I64) -> tuple[F64, I64]:
    """The same surface as a sloppy export has it: unshared corners, triangles without area, some twice."""
    corners = vertices[triangles]
    flat = corners[rng.integers(len(corners), size=5)].copy()
    flat[:, 2] = flat[:, 1]
    twice = corners[rng.integers(len(corners), size=3)]
    soup = np.concatenate([corners, flat, twice])
    soup = soup[rng.permutation(len(soup))]
    return soup.reshape(-1, 3), np.arange(3 * len(soup), dtype=np.int64).reshape(-1, 3)
