"""NumPy record types read from the C structs themselves."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from crease.base.native import ffi

_PRIMITIVES = {
    "float": "<f4",
    "double": "<f8",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "uint64_t": "<u8",
}
_VECTORS = {"cr_vec3": 3, "cr_quat": 4}


def _type_of(kind: Any) -> np.dtype[Any]:
    if kind.kind == "array":
        return np.dtype((_type_of(kind.item), (kind.length,)))
    if kind.kind == "pointer":
        return np.dtype(np.uintp)
    if kind.cname in _VECTORS:
        return np.dtype(("<f4", (_VECTORS[kind.cname],)))
    return record(kind.cname) if kind.kind == "struct" else np.dtype(_PRIMITIVES[kind.cname])


def record(
    name: str, opened: Collection[str] = (), names: Mapping[str, str] | None = None
) -> np.dtype[Any]:
    """The NumPy type of a C struct, with the offsets and the size that it has in C.

    opened: members whose own members stand in their place. names: what we call a member, where not as in C.
    """
    kind = ffi.typeof(name)
    members: list[tuple[str, Any, int]] = []
    for member, info in kind.fields:
        inner = info.type.fields if member in opened else ((member, info),)
        base = info.offset if member in opened else 0
        members += [(called, part.type, base + part.offset) for called, part in inner]
    return np.dtype(
        {
            "names": [(names or {}).get(called, called) for called, _, _ in members],
            "formats": [_type_of(part) for _, part, _ in members],
            "offsets": [offset for _, _, offset in members],
            "itemsize": ffi.sizeof(kind),
        },
        align=True,  # else arrays put together lose what C leaves free at the end
    )
