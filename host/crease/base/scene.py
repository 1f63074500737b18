"""Scene images: opened by the firmware's own parser, and told to a person."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from crease.base.alone import stays
from crease.base.errors import SceneError
from crease.base.native import error_text, ffi, lib
from crease.base.table import check_suffix, check_target, write_bytes

_ALIGN = 64
_MAGIC = b"CREASE\r\n"
_HEAD_BYTES = 64
"""Of a file, before it is known to be an image."""


def _aligned_copy(image: bytes) -> npt.NDArray[np.uint8]:
    """The bytes at an address that is a multiple of 64."""
    room = np.empty(len(image) + _ALIGN, dtype=np.uint8)
    start = -room.ctypes.data % _ALIGN
    aligned = room[start : start + len(image)]
    aligned[:] = np.frombuffer(image, dtype=np.uint8)
    return aligned


@dataclass(frozen=True)
class Scene:
    """An opened scene image. Read-only: any number of worlds and threads may share it.

    image: uint8 (n,), the bytes of the file. handle: a cffi `cr_scene *` into them. source: where it came from, for
    messages. meshes_glb: the two meshes it was baked from, for `crease view`; None when they are not there.
    warnings: what `bake` had to say.
    """

    image: npt.NDArray[np.uint8] = field(repr=False)
    handle: Any = field(repr=False)
    source: str
    meshes_glb: bytes | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()

    @classmethod
    def open(cls, path: str | Path) -> Scene:
        """The scene in a file SCENE.crs, with its meshes when SCENE.crs.glb is beside it.

        Errors   SceneError: cannot be read, or is no scene image of this version; the text says which.
        Cost     reads every byte once, 5 ms for 2 MB.
        Source   firmware/SPEC.md.
        """
        try:
            path = Path(path)
        except TypeError as error:
            raise SceneError(
                f"scene is a {type(path).__name__}; give what bake or Scene.open returned, or the path of a scene file"
            ) from error
        scene = open_scene(path)
        try:
            glb = meshes_path(path).read_bytes()
        except OSError:
            return scene
        return replace(scene, meshes_glb=glb)

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the image to SCENE.crs, and its meshes, if it has them, to SCENE.crs.glb: each whole or not at all.

        force: replace files that exist. Output: the path.
        Errors   CreaseError: another suffix, a file that exists, a folder that does not, a disk that refuses.
        """
        path = Path(path)
        check_suffix(path, (".crs",))
        files = {path: self.image.tobytes()}
        if self.meshes_glb is not None:
            files = {meshes_path(path): self.meshes_glb, **files}
        for file in files:
            check_target(file, force)
        for file, data in files.items():
            write_bytes(file, data)
        return path

    def __reduce__(self) -> NoReturn:
        stays("Scene", "send the path of its file, and call Scene.open there")

    def __copy__(self) -> Scene:
        return self  # nothing of it changes

    def __deepcopy__(self, _memo: object) -> Scene:
        return self

    @property
    def meta(self) -> Any:
        """The image's `struct cr_img_meta`, a cffi view."""
        return self.handle.meta

    def info(self) -> dict[str, object]:
        """What the image holds: plain numbers and texts, SI units in the names of the keys."""
        return describe_scene(self)


def meshes_path(scene: Path) -> Path:
    """Where the meshes of a scene image lie."""
    return scene.with_name(scene.name + ".glb")


def open_image(
    image: bytes, source: str, meshes_glb: bytes | None = None, warnings: tuple[str, ...] = ()
) -> Scene:
    """Validate an image.   Errors: SceneError with the firmware's reason."""
    if not image:
        raise SceneError(f"{source}: is an empty file; bake it again")
    aligned = _aligned_copy(image)
    handle = ffi.new("cr_scene *")
    code = int(lib.cr_scene_open(handle, ffi.from_buffer("uint8_t[]", aligned), len(aligned)))
    if code != lib.CR_OK:
        raise SceneError(f"{source}: {_trouble(image, code)}")
    return Scene(aligned, handle, source, meshes_glb, warnings)


def _trouble(image: bytes, code: int) -> str:
    """What is wrong with an image that was refused, and the mend."""
    if code == lib.CR_ERR_MAGIC:
        return "is no scene image; give the .crs that `crease bake` wrote"
    if code == lib.CR_ERR_VERSION:
        head = ffi.from_buffer("struct cr_img_header *", image)
        mend = "bake it again" if head.version < lib.CR_IMAGE_VERSION else "update crease"
        reads = f"this crease reads {lib.CR_IMAGE_VERSION}"
        return f"is a scene image of format {head.version}, {reads}; {mend}"
    text = _cut_off(image) if code == lib.CR_ERR_SIZE else error_text(code)
    return text if "bake it again" in text else f"{text}; bake it again"


def _cut_off(image: bytes) -> str:
    """Of an image that ends before the size its head tells, or within its head."""
    head = ffi.new("struct cr_img_header *")
    if len(image) < ffi.sizeof("struct cr_img_header"):
        return f"is cut off within its head, after {len(image)} bytes"
    ffi.buffer(head)[:] = image[: ffi.sizeof("struct cr_img_header")]
    if head.size_bytes <= len(image):
        return "is damaged: its head tells another size"
    return f"is cut off: it holds {len(image):,} of {head.size_bytes:,} bytes"


def open_scene(path: Path) -> Scene:
    """Read and validate an image file.   Errors: SceneError."""
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise SceneError(f"{path}: is no file; give the .crs that `crease bake` wrote")
        with path.open("rb") as file:
            image = file.read(_HEAD_BYTES)
            # What is no image is not read to its end, which it may not have.
            image += file.read() if image[: len(_MAGIC)] == _MAGIC else b""
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    return open_image(image, str(path))


def _vector(values: Any) -> list[float]:
    return [float(v) for v in values]


def _digest(values: Any) -> str:
    return bytes(values).hex()


def describe_scene(scene: Scene) -> dict[str, object]:
    """See Scene.info."""
    handle, meta = scene.handle, scene.meta
    header = ffi.cast("struct cr_img_header *", ffi.from_buffer(scene.image))
    return {
        "file": scene.source,
        "image_bytes": len(scene.image),
        "image_version": int(header.version),
        "image_crc32": f"{int(header.crc32):08x}",
        "static": {
            "triangles": int(meta.static_triangles),
            "unit_m": float(meta.static_unit_m),
            "min_m": _vector(meta.static_min_m),
            "max_m": _vector(meta.static_max_m),
            "sha256": _digest(meta.static_sha256),
            "patches": int(meta.patch_count),
            "facets": int(handle.facet_count),
            "smooth_edges": int(meta.smooth_edges),
            "convex_edges": int(meta.convex_edges),
            "concave_edges": int(meta.concave_edges),
            "crease_angle_deg": math.degrees(meta.crease_angle_rad),
        },
        "voxmap": {
            "voxel_m": float(meta.voxel_m),
            "brick_m": float(meta.brick_m),
            "dims": [int(n) for n in meta.dims],
            "origin_m": _vector(meta.origin_m),
            "bricks": int(handle.brick_count),
            "samples": int(handle.sample_count),
            "band_m": float(meta.band_m),
            "error_max_m": float(meta.error_max_m),
            "error_rms_m": float(meta.error_rms_m),
            "error_out_m": float(meta.error_out_m),
            "error_in_m": float(meta.error_in_m),
        },
        "tool": {
            "triangles": int(meta.tool_triangles),
            "unit_m": float(meta.tool_unit_m),
            "min_m": _vector(meta.tool_min_m),
            "max_m": _vector(meta.tool_max_m),
            "sha256": _digest(meta.tool_sha256),
            "points": int(meta.point_count),
            "clusters": int(handle.cluster_count),
            "groups": int(handle.group_count),
            "levels": int(meta.levels),
            "spacing_m": float(meta.spacing_m),
            "radius_m": float(meta.tool_radius_m),
            "area_m2": float(meta.shell_area_m2),
        },
    }
