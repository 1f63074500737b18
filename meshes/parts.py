"""Machine parts as users bring them, for `make bench-meshes`: made by formula, in mm, the same on every run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def solid_of(mesh: trimesh.Trimesh) -> Any:
    """A closed mesh as manifold3d has it."""
    return Manifold(
        Mesh64(
            vert_properties=np.ascontiguousarray(mesh.vertices, np.float64),
            tri_verts=np.ascontiguousarray(mesh.faces, np.uint64),
        )
    )


def mesh_of(solid: Any) -> trimesh.Trimesh:
    """A solid of manifold3d as a mesh."""
    out = solid.to_mesh64()
    return trimesh.Trimesh(
        out.vert_properties[:, :3], out.tri_verts.astype(np.int64), process=False
    )


def _cylinder(height: float, radius: float, sections: int = 96, top: float | None = None) -> Any:
    return Manifold.cylinder(height, radius, radius if top is None else top, sections, True)


def _box(x: float, y: float, z: float) -> Any:
    return Manifold.cube((x, y, z), True)


def involute_gear(teeth: int, module: float, width: float, bore: float) -> Any:
    """A spur gear of 20 degrees pressure angle about z; its first tooth points along x."""
    pitch, base = 0.5 * module * teeth, 0.5 * module * teeth * np.cos(np.radians(20.0))
    tip, root = pitch + module, pitch - 1.25 * module

    def involute(radius: Floats) -> Floats:
        turn = np.sqrt(np.maximum((radius / base) ** 2 - 1.0, 0.0))
        return np.asarray(turn - np.arctan(turn))

    radius = np.linspace(max(base, root), tip, 12)
    half = np.pi / (2 * teeth) + float(involute(np.array([pitch]))[0])
    flank = half - involute(radius)
    angle = np.concatenate([[-flank[0]], -flank, flank[::-1], [flank[0]]])
    reach = np.concatenate([[root], radius, radius[::-1], [root]])
    turns = (2 * np.pi / teeth * np.arange(teeth))[:, None]
    points = np.stack([reach * np.cos(angle + turns), reach * np.sin(angle + turns)], axis=-1)
    outline = CrossSection([points.reshape(-1, 2)])
    return Manifold.extrude(outline - CrossSection.circle(bore, 64), width)


def gear_pair() -> trimesh.Trimesh:
    """Two gears in mesh, module 2, 18 and 29 teeth, with clearance between the flanks: two shells."""
    one = involute_gear(18, 2.0, 10.0, 5.0)
    two = involute_gear(29, 2.0, 10.0, 8.0).rotate((0.0, 0.0, 180.0 + 180.0 / 29))
    return mesh_of(one + two.translate((47.3, 0.0, 0.0)))


def _revolved_grid(
    radius: Callable[[Floats, Floats], Floats], z: Floats, count: int
) -> trimesh.Trimesh:
    """A closed surface r(angle, z) about z with flat ends."""
    angle = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    a, h = np.meshgrid(angle, z)
    r = radius(a, h)
    rim = np.stack([r * np.cos(a), r * np.sin(a), h], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(z) - 1), np.arange(count), indexing="ij")
    p, q = (i * count + j).reshape(-1), (i * count + (j + 1) % count).reshape(-1)
    sides = np.concatenate(
        [np.column_stack([p, q, q + count]), np.column_stack([p, q + count, p + count])]
    )
    k = np.arange(count)
    low, high = len(rim), len(rim) + 1
    last = (len(z) - 1) * count
    ends = np.concatenate(
        [
            np.column_stack([(k + 1) % count, k, np.full(count, low)]),
            np.column_stack([last + k, last + (k + 1) % count, np.full(count, high)]),
        ]
    )
    vertices = np.vstack([rim, [[0.0, 0.0, z[0]], [0.0, 0.0, z[-1]]]])
    return trimesh.Trimesh(vertices, np.concatenate([sides, ends]), process=False)


def _thread(length: float, grow: float = 0.0) -> trimesh.Trimesh:
    """M8 x 1.25, full profile with flats; grow: clearance added to the radius."""
    pitch, outer = 1.25, 4.0 + grow
    depth = 0.61 * pitch

    def radius(angle: Floats, z: Floats) -> Floats:
        phase = (z / pitch - angle / (2 * np.pi)) % 1.0
        return np.asarray(outer - depth * np.clip(2.4 * np.abs(phase - 0.5) - 0.15, 0.0, 1.0))

    return _revolved_grid(radius, np.linspace(0.0, length, int(length / pitch * 16) + 1), 64)


def screw() -> trimesh.Trimesh:
    """M8 x 20 with a hexagon head."""
    head = _cylinder(5.3, 7.5, 6).translate((0.0, 0.0, -2.6))
    return mesh_of(solid_of(_thread(20.0)) + head)


def nut() -> trimesh.Trimesh:
    """M8 nut with its thread."""
    bore = solid_of(_thread(10.0, 0.1)).translate((0.0, 0.0, -5.0))
    return mesh_of(_cylinder(6.5, 7.5, 6) - bore)


def impeller() -> trimesh.Trimesh:
    """Nine blades 0.8 mm thick, curved backwards, on a hub with a bore and a back plate."""
    arc = np.linspace(0.0, 1.0, 24)
    middle = np.stack([8.0 + 30.0 * arc, 14.0 * arc**2], axis=1)
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = 0.4 * np.stack([-along[:, 1], along[:, 0]], axis=1)
    outline = CrossSection([np.concatenate([middle - side, (middle + side)[::-1]])])
    blade = Manifold.extrude(outline, 12.0)
    whole = _cylinder(14.0, 10.0).translate((0.0, 0.0, 7.0)) + _cylinder(2.0, 42.0, 128)
    for k in range(9):
        whole += blade.rotate((0.0, 0.0, 40.0 * k))
    return mesh_of(whole - _cylinder(60.0, 4.0, 64))


def bracket() -> trimesh.Trimesh:
    """An angle with two ribs, a fillet in its corner and four holes."""
    base, wall = _box(80, 60, 6).translate((40, 0, 3)), _box(6, 60, 70).translate((3, 0, 35))
    fillet = _box(10, 60, 10).translate((11, 0, 11)) - _cylinder(70, 10, 96).rotate(
        (90, 0, 0)
    ).translate((16, 0, 16))
    triangle = CrossSection([np.array([[5.0, 5.0], [60.0, 5.0], [5.0, 55.0]])])
    rib = Manifold.extrude(triangle, 4.0).rotate((90, 0, 0))
    whole = base + wall + fillet + rib.translate((0, 18, 0)) + rib.translate((0, -14, 0))
    hole = _cylinder(40, 4, 64)
    for x, y in ((55.0, 24.0), (55.0, -24.0), (70.0, 0.0)):
        whole -= hole.translate((x, y, 0))
    return mesh_of(whole - hole.rotate((0, 90, 0)).translate((0, 0, 60)))


def knob() -> trimesh.Trimesh:
    """Diamond knurls 0.5 mm deep on a cylinder of 15 mm."""

    def radius(angle: Floats, z: Floats) -> Floats:
        one, two = np.cos(36 * angle + 2.4 * z), np.cos(36 * angle - 2.4 * z)
        fade = np.clip(np.minimum(z, 16.0 - z) / 1.0, 0.0, 1.0)
        return np.asarray(15.0 - 0.5 * fade * (1.0 - np.maximum(one, two)))

    return _revolved_grid(radius, np.linspace(0.0, 16.0, 49), 288)


def lattice() -> trimesh.Trimesh:
    """Bars of 3 mm, 12 mm apart, four cells a side."""
    bars = []
    for i in range(5):
        for j in range(5):
            at = (12.0 * i - 24.0, 12.0 * j - 24.0, 0.0)
            bar = _box(3, 3, 51)
            bars += [
                bar.translate(at),
                bar.rotate((90, 0, 0)).translate((at[0], 0.0, at[1])),
                bar.rotate((0, 90, 0)).translate((0.0, at[0], at[1])),
            ]
    whole = bars[0]
    for bar in bars[1:]:
        whole += bar
    return mesh_of(whole)


def bone() -> trimesh.Trimesh:
    """A shaft with two heads and ripples, as from a scan: 20,480 triangles, no sharp edge."""
    ball = trimesh.creation.icosphere(5)
    unit = np.array(ball.vertices)
    z = 45.0 * unit[:, 2]
    swell = (
        6.0
        + 7.0 * np.abs(unit[:, 2]) ** 4
        + 0.3 * np.sin(9 * unit[:, 0] + 7 * unit[:, 1] + 11 * unit[:, 2])
    )
    across = unit[:, :2] * (swell * np.sqrt(1.0 - 0.6 * unit[:, 2] ** 2))[:, None]
    return trimesh.Trimesh(
        np.column_stack([across[:, 0] + 0.002 * z**2, across[:, 1], z]), ball.faces, process=False
    )


def shaft() -> trimesh.Trimesh:
    """Four steps, a keyway with round ends and a groove for a ring."""
    whole = _cylinder(25, 8).translate((0, 0, 12.5)) + _cylinder(40, 12).translate((0, 0, 45))
    whole += _cylinder(20, 15).translate((0, 0, 75)) + _cylinder(25, 10).translate((0, 0, 97.5))
    key = (
        _box(24, 4, 4)
        + _cylinder(4, 2, 48).translate((12, 0, 0))
        + _cylinder(4, 2, 48).translate((-12, 0, 0))
    )
    whole -= key.rotate((0, 90, 0)).translate((11.5, 0, 45))
    ring = _cylinder(1.3, 20) - _cylinder(2, 7)
    return mesh_of(whole - ring.translate((0, 0, 4)))


def pipe_tee() -> trimesh.Trimesh:
    """A tee of 30 mm pipe with 3 mm walls."""
    run, branch = _cylinder(90, 15).rotate((0, 90, 0)), _cylinder(50, 15).translate((0, 0, 25))
    inner = _cylinder(100, 12).rotate((0, 90, 0)) + _cylinder(60, 12).translate((0, 0, 30))
    return mesh_of(run + branch - inner)


PARTS: dict[str, Callable[[], trimesh.Trimesh]] = {
    "gear_pair": gear_pair,
    "screw": screw,
    "nut": nut,
    "impeller": impeller,
    "bracket": bracket,
    "knob": knob,
    "lattice": lattice,
    "bone": bone,
    "shaft": shaft,
    "pipe_tee": pipe_tee,
}
"""Name and maker of each part; lengths in mm."""


def _triangles_kept(mesh: trimesh.Trimesh, gone: NDArray[np.int64]) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, gone, axis=0), process=False)


def holes(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """One triangle in a hundred is missing."""
    rng = np.random.default_rng(1)
    return _triangles_kept(
        mesh, rng.choice(len(mesh.faces), max(1, len(mesh.faces) // 100), replace=False)
    )


def turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """One triangle in ten is wound the other way."""
    faces, rng = np.array(mesh.faces), np.random.default_rng(2)
    chosen = rng.choice(len(faces), max(1, len(faces) // 10), replace=False)
    faces[chosen] = faces[chosen][:, ::-1]
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def doubled(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """One triangle in ten stands twice."""
    rng = np.random.default_rng(3)
    more = np.array(mesh.faces)[
        rng.choice(len(mesh.faces), max(1, len(mesh.faces) // 10), replace=False)
    ]
    return trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, more]), process=False)


def pushed(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A ball pushed into the part: a shell across its surface."""
    size = float(np.ptp(mesh.vertices, axis=0).min())
    ball = trimesh.creation.icosphere(3, radius=0.2 * size)
    ball.apply_translation(mesh.triangles_center[len(mesh.faces) // 3])
    return trimesh.util.concatenate([mesh, ball])


def noisy(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Vertices off by 0.02 % of the size."""
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    shake = np.random.default_rng(4).normal(0.0, 2e-4 * size, mesh.vertices.shape)
    return trimesh.Trimesh(mesh.vertices + shake, mesh.faces, process=False)


def slivers(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Two hundred triangles are cut in three at a point a hair off one side."""
    faces, rng = np.array(mesh.faces), np.random.default_rng(5)
    chosen = rng.choice(len(faces), min(200, len(faces)), replace=False)
    a, b, c = np.array(mesh.vertices)[faces[chosen]].transpose(1, 0, 2)
    points = (0.5 - 5e-8) * (a + b) + 1e-7 * c
    new = len(mesh.vertices) + np.arange(len(chosen))
    pieces = [
        np.column_stack([faces[chosen, i], faces[chosen, (i + 1) % 3], new]) for i in range(3)
    ]
    return trimesh.Trimesh(
        np.vstack([mesh.vertices, points]),
        np.concatenate([np.delete(faces, chosen, axis=0), *pieces]),
        process=False,
    )


def t_junctions(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A third of the triangles is cut in four, their neighbours are not."""
    rng = np.random.default_rng(6)
    chosen = rng.choice(len(mesh.faces), max(1, len(mesh.faces) // 3), replace=False)
    corners = np.array(mesh.vertices)[np.array(mesh.faces)[chosen]]
    mid = 0.5 * (corners + np.roll(corners, -1, axis=1))
    parts = [np.delete(np.array(mesh.vertices)[mesh.faces], chosen, axis=0), mid]
    parts += [np.stack([corners[:, k], mid[:, k], mid[:, k - 1]], axis=1) for k in range(3)]
    soup = np.concatenate(parts)
    return trimesh.Trimesh(
        soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3), process=False
    )


def decimated(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Vertices gathered on a grid until a tenth of the triangles is left: folds where parts are thin."""
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    for cells in (400, 200, 100, 60, 40, 30, 20):
        step = size / cells
        keys = np.round(np.array(mesh.vertices) / step).astype(np.int64)
        _, first, kind = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        faces = kind.reshape(-1)[mesh.faces]
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        if np.count_nonzero(whole) <= max(len(mesh.faces) // 10, 60):
            break
    return trimesh.Trimesh(np.array(mesh.vertices)[first], faces[whole], process=False)


SPOILERS: dict[str, Callable[[trimesh.Trimesh], trimesh.Trimesh]] = {
    "clean": lambda mesh: mesh,
    "holes": holes,
    "turned": turned,
    "doubled": doubled,
    "pushed": pushed,
    "noise": noisy,
    "slivers": slivers,
    "t_junctions": t_junctions,
    "decimated": decimated,
    "inches": lambda mesh: trimesh.Trimesh(
        np.array(mesh.vertices) / 25.4, mesh.faces, process=False
    ),
}
"""Name and maker of each damage. `inches` is in inches, all others in the unit they were given in."""
