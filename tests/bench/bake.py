"""Time and memory of `crease bake`: a block of 45,000 triangles, cylinder of 983,040, ball of 1,310,720, large tools.

    python tests/bench/bake.py [--quick]        # quick: the block, and a tool of 22,000 samples
    python tests/bench/bake.py --shells         # the tools only

Needs build/meshes (make meshes). Bakes: wall time and peak memory of the whole command, mesh loading included. Tools: a
cube and balls, processor time and peak memory of the process so far.
"""

from __future__ import annotations

import argparse
import math
import resource
import tempfile
import time
from pathlib import Path

import trimesh
from bake_run import run_bake
from crease.bake.shell import make_shell
from crease.bake.surface import make_surface
from crease.mesh.mesh import make_mesh

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"


def time_shells(quick: bool) -> None:
    """Print one line per tool."""
    cube = trimesh.load_mesh(MESHES / "cube60_2700.stl")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=30.0)
    tools = [(cube, 20_000), (ball, 17_000), (ball, 730_000)]
    for shape, squares in tools[:1] if quick else tools:
        surface = make_surface(make_mesh(shape.vertices, shape.faces, 1e-3), 30.0)
        start_s = time.process_time()
        shell = make_shell(surface, 1e-3 * math.sqrt(shape.area / squares))
        cpu_s = time.process_time() - start_s
        memory_MiB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"shell {shell.points:>9,} samples: {cpu_s:5.1f} s of the processor, {memory_MiB:5.0f} MiB peak"
        )


def subdivided_cylinder() -> trimesh.Trimesh:
    """Sixty flat sides of slender triangles between creases: 983,040."""
    shape = trimesh.creation.cylinder(30.0, 80.0, sections=60)
    for _ in range(6):
        shape = shape.subdivide()
    return shape


def main() -> None:
    """Print one line per tool and per bake."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the smallest of each only")
    parser.add_argument("--shells", action="store_true", help="the tools only")
    args = parser.parse_args()
    quick = args.quick
    time_shells(quick)
    if args.shells:
        return
    tool = MESHES / "cube60_2700.stl"
    with tempfile.TemporaryDirectory() as folder:
        statics = [(MESHES / "block45k.stl", 45_000)]
        if not quick:
            ball = Path(folder) / "ball.stl"
            trimesh.creation.icosphere(subdivisions=8, radius=100.0).export(ball)
            cylinder = Path(folder) / "cylinder.stl"
            subdivided_cylinder().export(cylinder)
            statics += [(cylinder, 983_040), (ball, 1_310_720)]
        for static, triangles in statics:
            scene = Path(folder) / "out.crs"
            options = ("--unit", "mm", "--voxel", "2mm", "--spacing", "2mm", "--force")
            made = run_bake(static, tool, "-o", scene, *options)
            size = scene.stat().st_size / 2**20
            print(
                f"bake {triangles:>9,} triangles: {made.wall_s:5.1f} s, {made.cpu_s:5.1f} of the processor, "
                f"{made.memory_MiB:5.0f} MiB peak, image {size:.2f} MiB"
            )


if __name__ == "__main__":
    main()
