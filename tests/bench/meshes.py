"""What `crease bake` makes of machine parts, clean and spoiled: `make bench-meshes`.

    PYTHONPATH=meshes python tests/bench/meshes.py [--parts NAME...] [--damages NAME...] [--accept-only]
        [--judge MODULE:NAME] [-o DIR]

For each part of meshes/parts.py and of build/meshes, as it is and with each damage: whether it is accepted, share of
points on the wrong side, processor and wall time, peak memory, size of the image, largest distance error, samples. The
judge of the side is libigl's winding number of the clean part: points nearer to its surface than the damage moved it do
not count.

--judge names a function (scene image, folder) -> dict[str, str] whose columns follow: mesh_judge:judge has clearing and
amplification along a path (`make bench-meshes-force`).
"""

from __future__ import annotations

import argparse
import csv
import importlib
import json
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import igl
import numpy as np
import parts
import trimesh
from bake_run import BakeRun, run_bake
from crease.base.errors import CreaseError
from crease.mesh.mesh import load_mesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"
POINTS = 20_000
WITHIN = {"noise": 1e-3, "decimated": 6e-2, "holes": 2e-2}
"""Share of the diagonal that a damage moves the surface by, at most; 1e-5 for the others."""
ADDED = {"pushed"}
"""Damages that add material: points inside the clean part still have to be inside."""
Floats = NDArray[np.float64]
Judge = Callable[[Path, Path], dict[str, str]]


def all_parts() -> dict[str, Callable[[], trimesh.Trimesh]]:
    """Parts by formula, and those of `make meshes`."""
    files = {name: MESHES / f"{name}.stl" for name in ("spanner", "featuretype")}
    return {
        **parts.PARTS,
        **{name: partial(trimesh.load_mesh, path) for name, path in files.items()},
    }


def wrong_share(clean: trimesh.Trimesh, path: Path, unit_mm: float, damage: str) -> float:
    """Share of random points on the wrong side of the mended mesh.   Errors: CreaseError when it is refused."""
    mesh = load_mesh(path, unit_mm * 1e-3)
    low, high = clean.bounds
    points = low + (high - low) * np.random.default_rng(9).random((POINTS, 3))
    vertices = np.ascontiguousarray(clean.vertices)
    faces = np.ascontiguousarray(clean.faces, np.int64)
    inside = igl.fast_winding_number(vertices, faces, points) > 0.5
    mended = np.ascontiguousarray(mesh.vertices_m * 1e3)
    now = (
        igl.fast_winding_number(mended, np.ascontiguousarray(mesh.triangles, np.int64), points)
        > 0.5
    )
    wrong = inside & ~now if damage in ADDED else inside != now
    diagonal = float(np.linalg.norm(high - low))
    if wrong.any():
        away, _, _ = igl.point_mesh_squared_distance(points[wrong], vertices, faces)
        wrong[wrong] = np.sqrt(away) > WITHIN.get(damage, 1e-5) * diagonal
    return float(np.count_nonzero(wrong)) / POINTS


def bake(path: Path, unit: str, scene: Path) -> BakeRun:
    """One bake at defaults with a ball of 20 mm.   Errors: CreaseError."""
    ball = MESHES / "ball15.stl"
    return run_bake(
        path, ball, "-o", scene, "--unit", unit, "--tool-unit", "mm", "--force", "--json"
    )


def row(
    name: str, damage: str, clean: trimesh.Trimesh, folder: Path, args: argparse.Namespace
) -> dict[str, str]:
    """One line of the table."""
    mesh = parts.SPOILERS[damage](clean)
    unit, unit_mm = ("in", 25.4) if damage == "inches" else ("mm", 1.0)
    path = folder / f"{name}-{damage}.stl"
    mesh.export(path)
    line = {"part": name, "damage": damage, "triangles": f"{len(mesh.faces)}"}
    try:
        line["wrong_ppm"] = f"{1e6 * wrong_share(clean, path, unit_mm, damage):.0f}"
        line["accepted"] = "yes"
        if not args.accept_only:
            scene = folder / f"{name}-{damage}.crs"
            line |= baked(bake(path, unit, scene))
            if args.judge is not None:
                line |= args.judge(scene, folder)
    except CreaseError as error:
        line["accepted"] = f"no: {error}"
    return line


def baked(made: BakeRun) -> dict[str, str]:
    """The columns of a bake."""
    report = json.loads(made.said)["bake"]
    return {
        "cpu_s": f"{made.cpu_s:.1f}",
        "wall_s": f"{made.wall_s:.1f}",
        "memory_MiB": f"{made.memory_MiB:.0f}",
        "image_MiB": f"{report['image_bytes'] / 2**20:.2f}",
        "error_um": f"{report['error_max_m'] * 1e6:.0f}",
        "samples": f"{report['points']}",
    }


def judge(text: str) -> Judge:
    """The function that --judge names."""
    module, _, name = text.partition(":")
    found: Judge = getattr(importlib.import_module(module), name)
    return found


def main() -> int:
    """Print the table line by line, write it as CSV; status 1 when something was refused or wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=list(all_parts()), default=list(all_parts()))
    parser.add_argument(
        "--damages", nargs="+", choices=list(parts.SPOILERS), default=list(parts.SPOILERS)
    )
    parser.add_argument(
        "--accept-only", action="store_true", help="no bakes: acceptance and inside only"
    )
    parser.add_argument("--judge", type=judge)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build" / "bench")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    lines = []
    with tempfile.TemporaryDirectory() as temporary:
        for name in args.parts:
            clean = all_parts()[name]()
            for damage in args.damages:
                lines.append(row(name, damage, clean, Path(temporary), args))
                print("  ".join(f"{key} {value}" for key, value in lines[-1].items()), flush=True)
    with (args.output / "meshes.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(key for line in lines for key in line)))
        writer.writeheader()
        writer.writerows(lines)
    refused = sum(line.get("accepted") != "yes" for line in lines)
    wrong = sum(float(line.get("wrong_ppm", 0)) > 100 for line in lines)
    print(f"{len(lines)} meshes: {refused} refused, {wrong} with points on the wrong side")
    return int(refused > 0 or wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
