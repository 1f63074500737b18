"""The scenes that are judged (meshes/property_scenes.toml), and their images, kept by content."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import crease
from crease import _native
from crease.base.errors import CreaseError
from crease.base.scene import Scene, open_image, open_scene
from crease.base.table import write_bytes
from crease.mesh.mesh import Mesh, load_mesh

MM = 1e-3
ROOT = Path(crease.__file__).resolve().parents[2]
BAKE_C = (
    "host/native/bake.h",
    "host/native/vec.h",
    "host/native/surface/*",
    "host/native/probe.*",
    "firmware/**/image.h",
    "firmware/**/config.h",
)
"""C sources that decide what an image holds; the extension itself also changes with every change of the tick."""


@dataclass(frozen=True)
class PropertyScene:
    """One entry of the table; its head says what the fields mean. Lengths in mm."""

    name: str
    about: str
    family: str
    static: str
    tool: str
    path: str
    spacing_mm: float = 1.0
    voxel_mm: float | None = None
    jammed: bool = False
    convex: bool = False
    flat_z_mm: float | None = None
    walls: tuple[tuple[float, float, float, float], ...] = ()
    twin: str | None = None
    exchanged: str | None = None
    balance: str | None = None
    amplification_max: float = 3.0
    silent_max_mm: float | None = None


def load_scenes(table: Path) -> dict[str, PropertyScene]:
    """The scenes by name, in the order of the file.   Errors: CreaseError when it cannot be read."""
    try:
        entries = tomllib.loads(table.read_text(encoding="utf-8"))
        return {name: _scene(name, entry) for name, entry in entries.items()}
    except FileNotFoundError as error:
        raise CreaseError(
            f"{table}: is missing; run in a checkout, or name the table of scenes with --table"
        ) from error
    except (OSError, tomllib.TOMLDecodeError, TypeError, ValueError) as error:
        raise CreaseError(f"{table}: cannot be read as a table of scenes: {error}") from error


def _scene(name: str, entry: dict[str, Any]) -> PropertyScene:
    if unknown := set(entry) - {f.name for f in fields(PropertyScene)}:
        raise ValueError(f"{name}: unknown {', '.join(sorted(unknown))}")
    values = dict(entry)
    values["walls"] = tuple(tuple(map(float, wall)) for wall in values.get("walls", ()))
    return PropertyScene(name=name, **values)


def load_meshes(scene: PropertyScene, folder: Path) -> tuple[Mesh, Mesh]:
    """Obstacle and tool.   Errors: CreaseError."""
    files = [folder / name for name in (scene.static, scene.tool)]
    for file in files:
        if not file.exists():
            raise CreaseError(
                f"{file}: is missing; run `make meshes`, or name its folder with --meshes"
            )
    static, tool = (load_mesh(file, MM) for file in files)
    return static, tool


def bake_digest() -> str:
    """Digest of the code that bakes."""
    package = Path(crease.__file__).parent
    sources = [*package.rglob("bake/*.py")]
    sources += [f for name in ("mesh", "mend", "topology") for f in package.rglob(f"{name}.py")]
    c = [f for pattern in BAKE_C for f in ROOT.glob(pattern)]
    sources += c or [Path(_native.__file__)]
    return hashlib.sha256(b"".join(f.read_bytes() for f in sorted(sources))).hexdigest()


def image_of(scene: PropertyScene, meshes: tuple[Mesh, Mesh], folder: Path, code: str) -> Scene:
    """The image, baked when none of this content is in the folder.   Errors: CreaseError."""
    from crease.bake.bake import BakeOptions, bake_scene

    voxel_mm = scene.voxel_mm or scene.spacing_mm
    words = [code, *(m.digest_sha256 for m in meshes), f"{voxel_mm:g}", f"{scene.spacing_mm:g}"]
    key = hashlib.sha256(" ".join(words).encode()).hexdigest()[:20]
    file = folder / f"{key}.crs"
    if file.exists():
        return open_scene(file)
    options = BakeOptions(voxel_m=MM * voxel_mm, spacing_m=MM * scene.spacing_mm)
    data = bake_scene(*meshes, options, lambda _label, _part: None).image
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(file, data)
    return open_image(data, str(file))
