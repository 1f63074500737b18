"""What a GLB says of itself, looked at before its reader, which passes over what it does not know."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from crease.base.errors import MeshError

JSON_AT = 20
"""Bytes of the two heads before the text: of the file, and of its first chunk."""
MAGIC, VERSION, TEXT = b"glTF", 2, b"JSON"
"""What a GLB begins with, the version that is read, and the kind of its first chunk."""

HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
)
"""How extensions begin that say nothing of triangles."""
KNOWN = ("KHR_mesh_quantization",)
"""Extensions of triangles that are read."""
MENDS = {
    "KHR_draco_mesh_compression": "export it without compression",
    "EXT_meshopt_compression": "export it without compression",
    "KHR_meshopt_compression": "export it without compression",
    "EXT_mesh_gpu_instancing": "export every instance as a node of its own",
}
"""What to do about the others, where that is known."""
FLOAT = 5126
"""componentType of single precision."""
FAN = 6
"""mode of triangles round their first vertex."""


def glb_lacks(source: bytes) -> str:
    """What is wrong with a GLB that its reader does not read, without the reader's own words."""
    if len(source) < JSON_AT or not source.startswith(MAGIC):
        return _glb_headless(source)
    version, told, size = (int.from_bytes(source[at : at + 4], "little") for at in (4, 8, 12))
    if version != VERSION:
        return f"a GLB of version {version}, not {VERSION}"
    damaged = "damaged: what its text tells does not fit the bytes that follow"
    if len(source) < max(told, JSON_AT + size):
        return f"cut off: it holds {len(source):,} of {max(told, JSON_AT + size):,} bytes"
    if source[16:JSON_AT] != TEXT:
        return "damaged: its first chunk is no text"
    try:
        json.loads(source[JSON_AT : JSON_AT + size])
    except (ValueError, RecursionError):
        damaged = "damaged: its text is no JSON"
    return damaged


def _glb_headless(source: bytes) -> str:
    """The same of a file without the whole head of a GLB."""
    if not source:
        return "an empty file"
    if not source.startswith(MAGIC):
        return "no GLB: it does not begin with glTF"
    return f"cut off within its head: {len(source)} bytes"


def check_glb(path: Path, source: bytes) -> None:
    """Errors: MeshError for what its reader would read wrongly. What is damaged is left to the reader."""
    try:
        size = int.from_bytes(source[12:16], "little")
        told = json.loads(source[JSON_AT : JSON_AT + size])
        lacks = next(_unreadable(told), "")
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError):
        return
    if lacks:
        raise MeshError(f"{path}: {lacks}")


@contextmanager
def unsaid() -> Iterator[None]:
    """Within this the reader logs nothing: what is wrong is said in one line, or harmless."""
    log = logging.getLogger("trimesh")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


def _unreadable(told: dict[str, Any]) -> Iterator[str]:
    """What of a GLB is not read, with the mend."""
    for name in told.get("extensionsRequired", ()):
        if name not in KNOWN and not name.startswith(HARMLESS):
            yield f"needs the extension {name}, which is not read; {MENDS.get(name, 'export it without')}"
    nodes = told.get("nodes", ())
    for node in nodes:
        yield from _unread_node(told, node)
    accessors = told.get("accessors", ())
    for number in sorted({node["mesh"] for node in nodes if "mesh" in node}):
        for primitive in told["meshes"][number]["primitives"]:
            if primitive.get("mode") == FAN:
                yield f"mesh {number}: has a fan of triangles, which is not read; export single triangles"
            used = (primitive["attributes"].get("POSITION"), primitive.get("indices"))
            for index in used:
                if index is not None and (reason := _unread(accessors[index])):
                    yield f"mesh {number}: accessor {index} {reason}"


def _unread_node(told: dict[str, Any], node: dict[str, Any]) -> Iterator[str]:
    """The same of one node: what would make another mesh of it, or put it elsewhere."""
    for name in node.get("extensions", ()):
        if name in MENDS:
            yield f"uses the extension {name}, which is not read; {MENDS[name]}"
    number = node.get("mesh")
    if number is None:
        return
    if any(node.get("weights", told["meshes"][number].get("weights", ()))):
        yield f"mesh {number}: has a shape blended in (weights), which is not read; apply it and export again"
    if "skin" in node:
        yield f"mesh {number}: is moved by bones (skin), which are not read; apply them and export again"


def _unread(accessor: dict[str, Any]) -> str:
    """Why the numbers of an accessor are not read as they are meant; empty: they are."""
    if "sparse" in accessor:
        return "is sparse, which is not read; export it without sparse accessors"
    if "bufferView" not in accessor:
        return "has no numbers of its own; export it without compression"
    if accessor.get("normalized") and accessor.get("componentType") != FLOAT:
        return "holds normalized integers, which are not read; export it with positions as float"
    return ""
