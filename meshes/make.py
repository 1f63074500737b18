"""Write the meshes (binary STL, mm) and tool paths (CSV, metres) of the test scenes.

    python meshes/make.py [OUTDIR=build/meshes] [--only NAME]

Deterministic: fixed seeds, the same bytes on every run. Every mesh is reloaded from its float32
bytes and must be closed (each directed edge once, its reverse once) with positive volume.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import paths
import property_paths
import property_shapes
import scene_paths
import shapes
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
CUBE_TRIANGLES = (50, 100, 350, 800, 2700)
DT_S = 0.001
Floats = NDArray[np.float64]


def _box(
    lo: tuple[float, ...], hi: tuple[float, ...], count: int, seed: int
) -> Callable[[], shapes.Mesh]:
    return lambda: shapes.tessellated_box(lo, hi, count, seed)


def _cube(count: int, seed: int = 7, half: float = 30.0) -> Callable[[], shapes.Mesh]:
    return _box((-half,) * 3, (half,) * 3, count, seed)


STAIRS = [(-90.0, -30.0), (120.0, -30.0), (120.0, 48.0), (60.0, 48.0), (60.0, 24.0), (0.0, 24.0)]
STAIRS += [(0.0, 0.0), (-90.0, 0.0)]
GROOVE = [(-60.0, -25.0), (60.0, -25.0), (60.0, 25.0), (20.0, 25.0), (20.0, 0.0), (-20.0, 0.0)]
GROOVE += [(-20.0, 25.0), (-60.0, 25.0)]
VGROOVE = [
    (-60.0, -20.0),
    (60.0, -20.0),
    (60.0, 30.0),
    (30.0, 30.0),
    (0.0, 0.0),
    (-30.0, 30.0),
    (-60.0, 30.0),
]

MESHES: dict[str, Callable[[], shapes.Mesh]] = {
    "block45k": _box((-200.0, -100.0, -100.0), (0.0, 100.0, 0.0), 45000, 1),
    **{f"cube60_{n}": _cube(n) for n in CUBE_TRIANGLES},
    "cube20": _cube(300, half=10.0),
    "sphere50": lambda: shapes.ball(50.0, 5),
    "ball15": lambda: shapes.ball(15.0, 4),
    "corner": _box((-120.0,) * 3, (0.0,) * 3, 12, 2),
    "corner_fine": _box((-120.0,) * 3, (0.0,) * 3, 20000, 2),
    "wedge60": lambda: shapes.wedge(60.0),
    "wedge120": lambda: shapes.wedge(120.0),
    "stairs": lambda: shapes.prism_y(STAIRS, -60.0, 60.0),
    "groove": lambda: shapes.prism_y(GROOVE, -80.0, 80.0),
    "vgroove": lambda: shapes.prism_y(VGROOVE, -80.0, 80.0),
    "groove_tool": _box((-10.0, -10.0, -15.0), (10.0, 10.0, 15.0), 400, 3),
    "cylinder20": lambda: shapes.cylinder_y(20.0, 120.0, 180, 60),
    "wall": _box((-150.0, -150.0, -50.0), (150.0, 150.0, 0.0), 12, 4),
    "wall_fine": _box((-150.0, -150.0, -50.0), (150.0, 150.0, 0.0), 20000, 4),
    "bar": shapes.tapered_bar,
    "u_tool": shapes.u_tool,
    "plate": _box((-50.0, -50.0, -0.5), (50.0, 50.0, 0.5), 12, 5),
    "peg": shapes.peg,
    "hole_block": shapes.hole_block,
    "featuretype": lambda: shapes.feature_part(HERE / "featuretype.STL"),
    "screwdriver": shapes.screwdriver,
    "stylus": shapes.stylus,
    "spanner": lambda: shapes.spanner(HERE / "wrench.dxf"),
    **property_shapes.MESHES,
}
PATHS = {**scene_paths.PATHS, **property_paths.PATHS}


def write_file(path: Path, data: bytes) -> None:
    """Write all or nothing."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)


def stl_bytes(name: str, mesh: shapes.Mesh) -> bytes:
    """Binary STL, mm, float32, facets in the order of the mesh."""
    vertices, faces = mesh
    corners = vertices[faces].astype(np.float32)
    wide = corners.astype(float)
    normal = np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    records = np.zeros(len(faces), dtype=shapes.STL_RECORD)
    records["normal"] = normal / np.where(length > 0.0, length, 1.0)
    records["corners"] = corners
    head = f"crease meshes/make.py {name} unit=mm".encode().ljust(80, b" ")
    return head + np.uint32(len(faces)).tobytes() + records.tobytes()


def check_closed(name: str, stl: bytes) -> float:
    """Volume in mm^3 of a binary STL.

    Raises AssertionError if it is open, folded or inside out once equal vertices are welded.
    """
    corners = np.frombuffer(stl, dtype=shapes.STL_RECORD, offset=84)["corners"].reshape(-1, 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    faces = index.reshape(-1, 3).astype(np.int64)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward = np.sort(edges[:, 0] * len(vertices) + edges[:, 1])
    reverse = np.sort(edges[:, 1] * len(vertices) + edges[:, 0])
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
    repeated = bool(np.any(np.diff(forward) == 0)) or bool(np.any(edges[:, 0] == edges[:, 1]))
    if repeated or not np.array_equal(forward, reverse) or volume <= 0.0:
        raise AssertionError(f"{name}: mesh is not closed (volume {volume:.3f} mm^3)")
    return volume


def csv_bytes(path: paths.Path) -> bytes:
    """Trajectory CSV: t_s, x_m, y_m, z_m, qw, qx, qy, qz; quaternion signs continuous."""
    position, attitude = path
    quat = attitude.as_quat()[:, [3, 0, 1, 2]]
    flips = np.cumprod(np.where(np.einsum("ij,ij->i", quat[1:], quat[:-1]) < 0.0, -1.0, 1.0))
    quat[1:] *= flips[:, None]
    quat *= 1.0 if quat[0, 0] >= 0.0 else -1.0
    rows = ["t_s,x_m,y_m,z_m,qw,qx,qy,qz"]
    for k, (p, q) in enumerate(zip(position / 1000.0, quat, strict=True)):
        rows.append(
            ",".join([f"{k * DT_S:.3f}", *(f"{v:.9g}" for v in p), *(f"{v:.12g}" for v in q)])
        )
    return ("\n".join(rows) + "\n").encode().replace(b",-0,", b",0,")


def main() -> None:
    """Command line; see the module text."""
    parser = argparse.ArgumentParser(
        description="Write the meshes and tool paths of the test scenes."
    )
    parser.add_argument("outdir", nargs="?", type=Path, default=HERE.parent / "build" / "meshes")
    parser.add_argument("--only", metavar="NAME", help="write only this mesh or path")
    args = parser.parse_args()
    if args.only and args.only not in MESHES and args.only not in PATHS:
        parser.error(f"unknown name {args.only}; known: {' '.join([*MESHES, *PATHS])}")
    args.outdir.mkdir(parents=True, exist_ok=True)
    for name, build in MESHES.items():
        if args.only in (None, name):
            begin = time.perf_counter()
            stl = stl_bytes(name, build())
            volume = check_closed(name, stl)
            write_file(args.outdir / f"{name}.stl", stl)
            count = (len(stl) - 84) // 50
            spent = time.perf_counter() - begin
            print(f"{name}.stl: {count} triangles, {volume:.1f} mm^3, {spent:.2f} s")
    for name, trace in PATHS.items():
        if args.only in (None, name):
            begin = time.perf_counter()
            made = trace()
            write_file(args.outdir / f"{name}.csv", csv_bytes(made))
            print(f"{name}.csv: {len(made[0])} ticks, {time.perf_counter() - begin:.2f} s")


if __name__ == "__main__":
    main()
