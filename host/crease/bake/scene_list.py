"""The test scenes of a table (meshes/scenes.toml): which meshes, which path, which settings; and their images.

    python -m crease.bake.scene_list SCENES.toml MESHES OUT [NAME...]

bakes the named scenes (default: all) of the meshes in folder MESHES into OUT/NAME.crs with its meshes beside it, those
that are out of date.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

from crease import _native
from crease.bake.bodies import write_bodies
from crease.base.errors import CreaseError
from crease.base.scene import meshes_path
from crease.base.table import write_bytes
from crease.base.units import parse_unit
from crease.mesh.mesh import load_mesh


@dataclass(frozen=True)
class SceneSpec:
    """One scene of the table. Files lie in the folder of meshes; lengths in m."""

    name: str
    about: str
    static: Path
    tool: Path
    path: Path
    unit_m: float
    tool_unit_m: float
    voxel_m: float
    spacing_m: float
    stiffness_N_m: float
    exact: str | None


def load_specs(table: Path, meshes: Path) -> dict[str, SceneSpec]:
    """The scenes of a table by name.   Errors: CreaseError when it cannot be read."""
    try:
        entries = tomllib.loads(table.read_text(encoding="utf-8"))
        return {name: _spec(name, entry, meshes) for name, entry in entries.items()}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise CreaseError(f"{table}: cannot be read as a table of scenes: {error}") from error


def _spec(name: str, entry: dict[str, object], meshes: Path) -> SceneSpec:
    def text(key: str) -> str:
        return str(entry[key])

    def number(key: str) -> float:
        return float(text(key))

    return SceneSpec(
        name=name,
        about=text("about"),
        static=meshes / text("static"),
        tool=meshes / text("tool"),
        path=meshes / text("path"),
        unit_m=parse_unit(text("unit")),
        tool_unit_m=parse_unit(text("tool_unit")),
        voxel_m=1e-3 * number("voxel_mm"),
        spacing_m=1e-3 * number("spacing_mm"),
        stiffness_N_m=number("stiffness_N_m"),
        exact=text("exact") if "exact" in entry else None,
    )


def bake_spec(spec: SceneSpec, image: Path) -> int:
    """Write the image of a scene and its meshes beside it.   Output: bytes of the image.   Errors: CreaseError."""
    from crease.bake.bake import BakeOptions, bake_scene

    options = BakeOptions(voxel_m=spec.voxel_m, spacing_m=spec.spacing_m)
    static = load_mesh(spec.static, spec.unit_m)
    tool = load_mesh(spec.tool, spec.tool_unit_m)
    data = bake_scene(static, tool, options, lambda _label, _part: None).image
    write_bodies(image, static, tool)
    write_bytes(image, data)
    return len(data)


def is_current(image: Path, spec: SceneSpec, table: Path) -> bool:
    """Whether an image is newer than all it is made of: meshes, table, and the code that bakes."""
    return meshes_path(image).exists() and is_newer(image, spec.static, spec.tool, table)


def is_newer(image: Path, *made_of: Path) -> bool:
    """Whether an image is newer than the files it is made of and the code that bakes."""
    package = Path(__file__).parents[1]
    code = [Path(_native.__file__), *package.glob("mesh/*.py"), *package.glob("bake/*.py")]
    return image.exists() and all(
        p.stat().st_mtime <= image.stat().st_mtime for p in (*made_of, *code)
    )


def main(argv: list[str] | None = None) -> int:
    """See the module."""
    parser = argparse.ArgumentParser(
        prog="python -m crease.bake.scene_list", description="Bake test scenes."
    )
    parser.add_argument("table", type=Path)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*")
    args = parser.parse_args(argv)
    try:
        specs = load_specs(args.table, args.meshes)
        if unknown := [name for name in args.names if name not in specs]:
            raise CreaseError(
                f"{args.table}: no scene {', '.join(unknown)}; there are {', '.join(specs)}"
            )
        args.out.mkdir(parents=True, exist_ok=True)
        for name in args.names or specs:
            image = args.out / f"{name}.crs"
            if is_current(image, specs[name], args.table):
                continue
            start_s = time.monotonic()
            size = bake_spec(specs[name], image)
            print(
                f"{image}: {size / 2**20:.2f} MiB, {time.monotonic() - start_s:.1f} s",
                flush=True,
            )
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
