"""What `crease bake` makes of machine parts, clean and spoiled: `make bench-meshes`.

    PYTHONPATH=meshes python tests/bench/meshes.py [--parts NAME...] [--damages NAME...] [--accept-only]
        [--judge MODULE:NAME] [-o DIR] [--write]

For each part of meshes/parts.py and of build/meshes, as it is and with each damage: whether it is accepted, share of
points on the wrong side, processor and wall time, peak memory, size of the image, largest distance error, samples. The
judge of the side is libigl's winding number of the clean part: points nearer to its surface than the damage moved it do
not count. A ball is drawn over every ridge and pocket of the clean part, and along the same paths in each spoiled one:
how far the force over the stiffness is off, beside how far the damage moved the surface (libigl, both ways).

--write makes the page MESHES.md of the table.

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
from crease.bake.bodies import read_bodies
from crease.bake.surface import make_surface
from crease.base.errors import CreaseError
from crease.base.scene import open_scene
from crease.mesh.mesh import load_mesh, make_mesh
from crease.replay.replay import ReplayOptions
from mesh_paths import strokes
from numpy.typing import NDArray
from study.properties.answers import asker

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"
PAGE = Path(__file__).with_name("MESHES.md")
POINTS = 20_000
WITHIN = {"noise": 1e-3, "decimated": 6e-2, "holes": 2e-2}
"""Share of the diagonal that a damage moves the surface by, at most; 1e-5 for the others."""
ADDED = {"pushed"}
"""Damages that add material: points inside the clean part still have to be inside."""
COSTS = ("triangles", "wall_s", "memory_MiB", "image_MiB", "error_um", "samples")
OFF = ("moved_p99_mm", "force_off_rms_mm", "force_off_p99_mm")
HEAD = """# Meshes of machine parts, clean and spoiled

    make bench-meshes                   # 15 minutes; writes this page and build/bench/meshes.csv

Twelve parts as they are and spoiled in nine ways (`meshes/parts.py`), baked at default settings with a ball of 30 mm.
Of {count} meshes {accepted} are accepted, {wrong} have a point on the wrong side of the surface, of 20,000 each (judge:
libigl's winding number of the clean part). Seconds are of the clock on two cores, reading and checking included.

| part | triangles | s | memory, MiB | image, MiB | distance error, um | samples |
|---|---|---|---|---|---|---|
"""
DAMAGED = """
A ball is drawn over every ridge and pocket of the clean part, 0.6 mm deep, and along the same paths in the spoiled one:
force over stiffness, mm, off by, and how far the damage moved the surface (points spread over either, to the other;
libigl).

| damage | median over parts: moved, p99 | force off, RMS | p99 | largest: moved | force off, p99 |
|---|---|---|---|---|---|
"""
FORCE = """
## Force over ridges and pockets

    make bench-meshes-force             # 10 minutes; writes this section and build/bench/force/meshes.csv

Three tools are drawn over every ridge and pocket of the clean parts, 0.6 mm deep (`tests/bench/mesh_paths.py`). Not
clear: share of deep poses whose force, as a shift, is not 0.9 to 1.05 of what leads out, by booleans; jammed poses do
not count. Amplification: 99th percentile / largest. Off: force over stiffness of the ball against voxels a third as
large, mm, RMS / 99th percentile.

| part | ball: not clear | amplification | off | box: not clear | amplification | stylus: not clear | amplification |
|---|---|---|---|---|---|---|---|
"""
LIMITS = """
Where the force is off by more than the surface moved: on the threads of the screw, which a ball touches in more zones
than there is room for, so that the lightest are lost; on the impeller, whose thin blades leave their half-spaces no
direction of their own; with noise on round faces, as each triangle is a plane.
"""
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
    """Share of random points that the bake takes for the wrong side.   Errors: CreaseError when the mesh is refused."""
    mesh = load_mesh(path, unit_mm * 1e-3)
    low, high = clean.bounds
    points = low + (high - low) * np.random.default_rng(9).random((POINTS, 3))
    vertices = np.ascontiguousarray(clean.vertices)
    faces = np.ascontiguousarray(clean.faces, np.int64)
    inside = igl.fast_winding_number(vertices, faces, points) > 0.5
    now = make_surface(mesh, 30.0).signed_distance(1e-3 * points)[0] < 0.0
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
        path,
        ball,
        "-o",
        scene,
        "--unit",
        unit,
        "--tool-unit",
        "mm",
        "--force",
        "--json",
    )


class Compared:
    """The force of a ball along paths over a clean part, and how far it is off in spoiled ones."""

    def __init__(self) -> None:
        self.paths: list[Floats] = []
        self.way_mm = np.zeros((0, 3))

    def columns(self, damage: str, scene: Path, clean: trimesh.Trimesh) -> dict[str, str]:
        """Of the clean part first: it says the paths."""
        opened = open_scene(scene)
        body, ball = read_bodies(opened)
        if damage == "clean":
            static = make_mesh(body.vertices_m, body.triangles, 1.0, source=scene.stem)
            surface = make_surface(static, float(np.degrees(opened.meta.crease_angle_rad)))
            self.paths = strokes(surface, 1e3 * ball.vertices_m, ball.triangles.astype(np.int32))
        ask = asker(opened, ReplayOptions())
        answers = [ask(poses) for poses in self.paths]
        way_mm = np.concatenate([np.zeros((0, 3)), *(answer.way_mm for answer in answers)])
        if damage == "clean":
            self.way_mm = way_mm
            return {"paths": str(len(self.paths))}
        touching = np.linalg.norm(np.stack([way_mm, self.way_mm]), axis=2).max(axis=0) > 0.0
        off = np.linalg.norm(way_mm - self.way_mm, axis=1)[touching]
        moved = moved_mm(clean, 1e3 * body.vertices_m, body.triangles.astype(np.int64))
        return {
            "paths": str(len(self.paths)),
            "moved_p99_mm": f"{np.percentile(moved, 99):.3f}",
            "moved_max_mm": f"{moved.max():.3f}",
            "force_off_rms_mm": f"{np.sqrt((off**2).mean()):.3f}",
            "force_off_p99_mm": f"{np.percentile(off, 99):.3f}",
            "force_off_max_mm": f"{off.max():.3f}",
        }


def moved_mm(clean: trimesh.Trimesh, vertices: Floats, faces: NDArray[np.int32]) -> Floats:
    """Distances from points spread over either surface to the other, mm, (n,)."""
    mended = trimesh.Trimesh(vertices, faces, process=False)
    away = []
    for one, other in ((clean, mended), (mended, clean)):
        points = trimesh.sample.sample_surface(one, POINTS, seed=9)[0]
        square, _, _ = igl.point_mesh_squared_distance(
            points,
            np.ascontiguousarray(other.vertices),
            np.ascontiguousarray(other.faces, np.int64),
        )
        away.append(np.sqrt(square))
    return np.concatenate(away)


def row(
    name: str,
    damage: str,
    clean: trimesh.Trimesh,
    folder: Path,
    args: argparse.Namespace,
    compared: Compared,
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
            if compared.paths or damage == "clean":
                line |= compared.columns(damage, scene, clean)
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


def most(lines: list[dict[str, str]], key: str) -> dict[str, str] | None:
    """The line with the largest value of a column."""
    return max(
        (line for line in lines if key in line),
        key=lambda line: float(line[key]),
        default=None,
    )


def page(lines: list[dict[str, str]]) -> str:
    """MESHES.md: a row for each part as it is, one for the worst of its spoiled versions, and one for each damage."""
    text = HEAD.format(
        count=len(lines),
        accepted=sum(line["accepted"] == "yes" for line in lines),
        wrong=sum(float(line.get("wrong_ppm", 0)) > 0 for line in lines),
    )
    for name in dict.fromkeys(line["part"] for line in lines):
        mine = [line for line in lines if line["part"] == name]
        for label, these in (("", mine[:1]), (", worst of spoiled", mine[1:])):
            worst = {key: most(these, key) for key in COSTS}
            cells = [
                "" if found is None else found[key] + ("" if not label else f" ({found['damage']})")
                for key, found in worst.items()
            ]
            text += f"| {name}{label} | {' | '.join(cells)} |\n"
    text += DAMAGED
    for damage in dict.fromkeys(line["damage"] for line in lines if line["damage"] != "clean"):
        mine = [line for line in lines if line["damage"] == damage and OFF[0] in line]
        cells = [f"{np.median([float(line[key]) for line in mine]):.3f}" for key in OFF]
        for key in ("moved_max_mm", "force_off_p99_mm"):
            found = most(mine, key)
            cells.append("" if found is None else f"{found[key]} ({found['part']})")
        text += f"| {damage} | {' | '.join(cells)} |\n"
    return text + LIMITS


def force_section(lines: list[dict[str, str]]) -> str:
    """The section of MESHES.md on the force, of lines with the columns of mesh_judge."""
    text = FORCE
    for line in lines:
        cells = []
        for tool in ("ball", "box", "stylus"):
            key = f"{tool}_way_out"
            cells.append(line.get(f"{key}_clear_outside", ""))
            rates = (line.get(f"{key}_amplification{end}", "") for end in ("_p99", ""))
            cells.append(" / ".join(rates))
            if tool == "ball":
                ends = (line.get(f"force_error_{end}_mm", "") for end in ("rms", "p99"))
                cells.append(" / ".join(ends))
        text += f"| {line['part']} | {' | '.join(cells)} |\n"
    return text


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
        "--damages",
        nargs="+",
        choices=list(parts.SPOILERS),
        default=list(parts.SPOILERS),
    )
    parser.add_argument(
        "--accept-only",
        action="store_true",
        help="no bakes: acceptance and inside only",
    )
    parser.add_argument("--judge", type=judge)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build" / "bench")
    parser.add_argument(
        "--write",
        action="store_true",
        help="write MESHES.md, or with --judge its force",
    )
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    lines = []
    with tempfile.TemporaryDirectory() as temporary:
        for name in args.parts:
            clean, compared = all_parts()[name](), Compared()
            for damage in args.damages:
                lines.append(row(name, damage, clean, Path(temporary), args, compared))
                print(
                    "  ".join(f"{key} {value}" for key, value in lines[-1].items()),
                    flush=True,
                )
    with (args.output / "meshes.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(key for line in lines for key in line)))
        writer.writeheader()
        writer.writerows(lines)
    if args.write:
        before = PAGE.read_text(encoding="utf-8").partition(FORCE[: FORCE.index("\n\n")])
        kept = before[1] + before[2]
        made = page(lines) + kept if args.judge is None else before[0] + force_section(lines)
        PAGE.write_text(made, encoding="utf-8")
    refused = sum(line.get("accepted") != "yes" for line in lines)
    wrong = sum(float(line.get("wrong_ppm", 0)) > 100 for line in lines)
    print(f"{len(lines)} meshes: {refused} refused, {wrong} with points on the wrong side")
    return int(refused > 0 or wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
