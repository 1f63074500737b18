"""The two meshes of a scene, as they were baked: SCENE.crs.glb beside SCENE.crs. For the eye; no tick reads them."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import SceneError
from crease.base.scene import Scene, meshes_path
from crease.base.table import describe, write_bytes
from crease.mesh.glb import glb_lacks, unsaid
from crease.mesh.mesh import Mesh

NAMES = ("static", "tool")


@dataclass(frozen=True)
class Body:
    """A surface to draw.   Shapes: vertices_m float64 (n, 3), frame of the body; triangles int64 (m, 3)."""

    vertices_m: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]


def pack_bodies(static: Mesh, tool: Mesh) -> bytes:
    """Both meshes as one GLB file of metres, with the digests of the files they came from."""
    import trimesh

    meshes = dict(zip(NAMES, (static, tool), strict=True))
    scene = trimesh.Scene(
        {
            name: trimesh.Trimesh(mesh.vertices_m, mesh.triangles, process=False)
            for name, mesh in meshes.items()
        }
    )
    scene.metadata = {f"{name}_sha256": mesh.digest_sha256 for name, mesh in meshes.items()}
    data: bytes = scene.export(file_type="glb")
    return data


def write_bodies(scene: Path, static: Mesh, tool: Mesh) -> Path:
    """The meshes beside the image `scene`.   Errors: CreaseError when the disk refuses."""
    path = meshes_path(scene)
    write_bytes(path, pack_bodies(static, tool))
    return path


def read_bodies(scene: Scene) -> tuple[Body, Body]:
    """Obstacle and tool of an image that was opened from a file.

    Errors: SceneError when the file beside the image is missing, damaged, or of other meshes.
    """
    import trimesh

    path = meshes_path(Path(scene.source))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneError(
            f"{path}: the meshes that bake writes beside the image cannot be read: {describe(error)}; bake it again"
        ) from error
    try:
        with unsaid():
            loaded = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
        found = [_body(loaded.geometry[name]) for name in NAMES]
        digests = [str(loaded.metadata[f"{name}_sha256"]) for name in NAMES]
    except Exception as error:  # the reader raises whatever a damaged file leads it to
        raise SceneError(
            f"{path}: is {glb_lacks(data)}; bake the scene again for its meshes"
        ) from error
    meta = scene.meta
    if digests != [bytes(meta.static_sha256).hex(), bytes(meta.tool_sha256).hex()]:
        raise SceneError(
            f"{path}: holds other meshes than {scene.source} is made of; bake it again"
        )
    return found[0], found[1]


def _body(mesh: Any) -> Body:
    return Body(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))


def reduce_body(body: Body, triangles_max: int) -> Body:
    """The body with at most so many triangles, its vertices gathered on a grid that is as coarse as that takes.

    Good enough to look at. Output: the same body when it is small enough.
    """
    low = body.vertices_m.min(axis=0)
    span = float(np.ptp(body.vertices_m, axis=0).max())
    cells, reduced = 1024.0, body
    while len(reduced.triangles) > triangles_max:
        x, y, z = np.round((body.vertices_m - low) * (cells / span)).astype(np.int64).T
        _, first, index = np.unique(
            (x << 40) + (y << 20) + z, return_index=True, return_inverse=True
        )
        corners = index.reshape(-1)[body.triangles]
        a, b, c = corners.T
        reduced = Body(body.vertices_m[first], corners[(a != b) & (b != c) & (c != a)])
        cells /= 1.25
    return reduced
