"""Write the benchmark's meshes (binary STL, mm), paths (CSV, m and s), hand paths (NPZ) and definitions (JSON).

    python meshes/six/make_six.py [OUTDIR=build/meshes/six] [--only NAME] [--definitions]

Needs numpy, scipy and manifold3d. Deterministic. With --definitions the exact wrenches are computed anew and the JSON
files beside this script are written; else they are copied.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import manifold3d as mf
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

import six_paths  # noqa: E402
from six_scenes import GOALS, HAND, SCENES, SPRINGS, Scene, exact  # noqa: E402

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def stl_bytes(solid: mf.Manifold) -> bytes:
    """Binary STL, float32, mm."""
    mesh = solid.to_mesh()
    corners = np.asarray(mesh.vert_properties[:, :3], np.float32)[mesh.tri_verts]
    wide = corners.astype(np.float64)
    normal = np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0])
    records = np.zeros(len(corners), RECORD)
    records["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    records["corners"] = corners
    return (
        b"crease meshes/six unit=mm".ljust(80)
        + np.uint32(len(corners)).tobytes()
        + records.tobytes()
    )


def path_bytes(path: six_paths.Path) -> bytes:
    """t_s, x_m, y_m, z_m, qw, qx, qy, qz; quaternion signs continuous."""
    quat = path[1].as_quat()[:, [3, 0, 1, 2]]
    quat[1:] *= np.cumprod(np.where(np.sum(quat[1:] * quat[:-1], axis=1) < 0.0, -1.0, 1.0))[:, None]
    lines = ["t_s,x_m,y_m,z_m,qw,qx,qy,qz"]
    for k, (p, q) in enumerate(zip(1e-3 * path[0], quat, strict=True)):
        lines.append(
            ",".join([f"{1e-3 * k:.3f}", *(f"{v:.9g}" for v in p), *(f"{v:.12g}" for v in q)])
        )
    return ("\n".join(lines) + "\n").encode()


def definition(name: str, scene: Scene) -> dict[str, Any]:
    """What the JSON file holds."""
    return {
        "name": name,
        "about": scene.about,
        "unit": "mm",
        "static": f"{name}.static.stl",
        "tool": f"{name}.tool.stl",
        "path": f"{name}.csv",
        "spring": {
            "stiffness_N_m": SPRINGS[0],
            "stiffness_Nm_rad": SPRINGS[1],
            "damping": 0.0,
            "centre_tool_mm": [0.0, 0.0, 0.0],
        },
        "friction": scene.friction,
        "tool_radius_mm": scene.radius_mm,
        "image": {
            "voxel_mm": scene.image[0],
            "spacing_mm": scene.image[1],
            **scene.image_more,
        },
        **scene.more,
        **({"hand": HAND} if "hands" in scene.more else {}),
        "goals": GOALS,
        "exact": {
            "how": scene.how,
            "columns": ["tick", "fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"],
            "rows": exact(scene),
        },
    }


def json_text(value: dict[str, Any]) -> str:
    """One member a line; rows of numbers one a line."""
    text = json.dumps(value, indent=1)
    rows = value["exact"]["rows"]
    head = text[: text.index('"rows": ') + len('"rows": ')]
    body = ",\n   ".join(json.dumps(row) for row in rows)
    return f"{head}[{body}]\n }}\n}}\n"


def hands_file(path: Path) -> None:
    """t_s (n,), position_m (50, n, 3), quaternion (50, n, 4): w x y z."""
    place, quat = six_paths.hands()
    t = 1e-3 * np.arange(six_paths.HAND_TICKS)
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            t_s=t,
            position_m=(1e-3 * place).astype(np.float32),
            quaternion=quat.astype(np.float32),
        )


def write_scene(outdir: Path, name: str) -> None:
    """Solids, path and definition of a scene."""
    scene = SCENES[name]
    (outdir / f"{name}.json").write_bytes((HERE / f"{name}.json").read_bytes())
    for part, solid in (("static", scene.static()), ("tool", scene.tool())):
        (outdir / f"{name}.{part}.stl").write_bytes(stl_bytes(solid))
    (outdir / f"{name}.csv").write_bytes(path_bytes(scene.path()))


def main() -> None:
    """Command line; see the module text."""
    parser = argparse.ArgumentParser(
        description="Write meshes, paths and definitions of the benchmark."
    )
    parser.add_argument(
        "outdir", nargs="?", type=Path, default=HERE.parents[1] / "build" / "meshes" / "six"
    )
    parser.add_argument("--only", metavar="NAME", choices=sorted(SCENES))
    parser.add_argument(
        "--definitions",
        action="store_true",
        help="compute exact wrenches anew, write the JSON files beside this script",
    )
    args = parser.parse_args()
    args.outdir.mkdir(parents=True, exist_ok=True)
    for name, scene in SCENES.items():
        if args.only in (None, name):
            if args.definitions:
                text = json_text(definition(name, scene))
                (HERE / f"{name}.json").write_text(text, encoding="utf-8")
            write_scene(args.outdir, name)
            print(f"{name}: {scene.about}")
    hands_file(args.outdir / "peg_hands.npz")


if __name__ == "__main__":
    main()
