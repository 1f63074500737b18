"""Time and memory of `crease bake`: the 45,000-triangle block and a ball of 1,310,720 triangles.

    python tests/bench/bake.py [--quick]        # quick: the block only

Needs build/meshes (make meshes). Wall time and peak memory of the whole command, mesh loading included.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import trimesh

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"


def bake(static: Path, tool: Path, scene: Path) -> tuple[float, float]:
    """Seconds and peak resident MiB of one bake at 2 mm.   Errors: RuntimeError with the command's own words."""
    command = [
        sys.executable,
        "-m",
        "crease",
        "bake",
        str(static),
        str(tool),
        "-o",
        str(scene),
        "--unit",
        "mm",
    ]
    command += ["--voxel", "2mm", "--spacing", "2mm", "--force"]
    start_s = time.monotonic()
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(said.strip())
    return time.monotonic() - start_s, usage.ru_maxrss / 1024


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
            seconds, mebibytes = bake(static, tool, scene)
            size = scene.stat().st_size / 2**20
            print(
                f"bake {triangles:>9,} triangles: {seconds:5.1f} s, {mebibytes:5.0f} MiB peak, image {size:.2f} MiB"
            )


if __name__ == "__main__":
    main()
