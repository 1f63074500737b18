"""Time and memory of `crease bake`: the 45,000-triangle block and a ball of 1,310,720 triangles.

    python tests/bench/bake.py [--quick]        # quick: the block only

Needs build/meshes (make meshes). Wall time and peak memory of the whole command, mesh loading included.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import trimesh
from bake_run import run_bake

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"


def main() -> None:
    """Print one line per bake."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the block only")
    quick = parser.parse_args().quick
    tool = MESHES / "cube60_2700.stl"
    with tempfile.TemporaryDirectory() as folder:
        statics = [(MESHES / "block45k.stl", 45_000)]
        if not quick:
            ball = Path(folder) / "ball.stl"
            trimesh.creation.icosphere(subdivisions=8, radius=100.0).export(ball)
            statics.append((ball, 1_310_720))
        for static, triangles in statics:
            scene = Path(folder) / "out.crs"
            options = ("--unit", "mm", "--voxel", "2mm", "--spacing", "2mm", "--force")
            made = run_bake(static, tool, "-o", scene, *options)
            size = scene.stat().st_size / 2**20
            print(
                f"bake {triangles:>9,} triangles: {made.wall_s:5.1f} s, "
                f"{made.memory_MiB:5.0f} MiB peak, image {size:.2f} MiB"
            )


if __name__ == "__main__":
    main()
