"""Record types of the scene image, and the packing of sections."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.native import ffi, lib
from crease.base.records import record

META = record("struct cr_img_meta")
BRICK = record("struct cr_img_brick")
KIND = record("struct cr_img_kind")
FACET = record("struct cr_img_facet")
PAIR = record("struct cr_img_pair")
EDGE = record("struct cr_img_edge")
CLUSTER = record("struct cr_img_cluster")
SUM = record("struct cr_img_sum")
NEIGHBOUR = record("struct cr_img_neighbour")
GROUP = record("struct cr_img_group")
HEADER = record("struct cr_img_header")
SECTION = record("struct cr_img_section")

RECORDS = {
    int(lib.CR_SEC_META): META,
    int(lib.CR_SEC_BRICKS): BRICK,
    int(lib.CR_SEC_KINDS): KIND,
    int(lib.CR_SEC_FACETS): FACET,
    int(lib.CR_SEC_PAIRS): PAIR,
    int(lib.CR_SEC_EDGES): EDGE,
    int(lib.CR_SEC_CLUSTERS): CLUSTER,
    int(lib.CR_SEC_SUMS): SUM,
    int(lib.CR_SEC_GROUPS): GROUP,
    int(lib.CR_SEC_ADJ): NEIGHBOUR,
}
"""Record of each section that holds records; the others hold whole numbers."""

LANES = int(lib.CR_LANES)
ALIGN = int(lib.CR_IMG_ALIGN)
CELLS_SIDE = int(lib.CR_CELLS_SIDE)
CELLS_NONE = int(lib.CR_CELLS_NONE)
KIND_FACETS_MAX = int(lib.CR_KIND_FACETS_MAX)
FINE_TABLE, FINE_BLOCKS = int(lib.CR_FINE_TABLE), int(lib.CR_FINE_BLOCKS)
FINE_UNIT, FINE_QUARTERS = int(lib.CR_FINE_UNIT), int(lib.CR_FINE_QUARTERS)

MAGIC = b"CREASE\r\n"


def _padded(count: int) -> int:
    return -(-count // ALIGN) * ALIGN


def pack(sections: dict[int, npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """One image of all sections, checksum included.

    Shapes: sections maps every CR_SEC_* to a 1-D array (records or numbers).
    """
    ids = sorted(sections)
    assert ids == list(range(1, int(lib.CR_SEC_COUNT) + 1))
    head = _padded(HEADER.itemsize + len(ids) * SECTION.itemsize)
    table = np.zeros(len(ids), SECTION)
    at = head
    for row, key in enumerate(ids):
        data = sections[key]
        table[row] = (key, at, len(data), data.dtype.itemsize)
        at = _padded(at + data.nbytes)
    image = np.zeros(at, np.uint8)
    header = np.zeros(1, HEADER)
    header["magic"] = np.frombuffer(MAGIC, np.uint8)
    header["version"] = lib.CR_IMAGE_VERSION
    header["size_bytes"] = at
    header["section_count"] = len(ids)
    image[: HEADER.itemsize] = header.view(np.uint8).reshape(-1)
    image[HEADER.itemsize : HEADER.itemsize + table.nbytes] = table.view(np.uint8).reshape(-1)
    for row, key in enumerate(ids):
        data = np.ascontiguousarray(sections[key])
        start = int(table[row]["offset"])
        image[start : start + data.nbytes] = data.view(np.uint8).reshape(-1)
    seal(image)
    return image


def read_sections(image: npt.NDArray[np.uint8]) -> dict[int, npt.NDArray[Any]]:
    """The sections of a valid image, as `pack` takes them: records of RECORDS, else raw elements of their size."""
    count = int(image[: HEADER.itemsize].view(HEADER)[0]["section_count"])
    table = image[HEADER.itemsize : HEADER.itemsize + count * SECTION.itemsize].view(SECTION)
    sections = {}
    for key, offset, length, stride in table.tolist():
        part = image[offset : offset + length * stride]
        sections[key] = part.view(RECORDS.get(key, np.dtype((np.void, stride))))
    return sections


def seal(image: npt.NDArray[np.uint8]) -> None:
    """Write the checksum of the image into its header."""
    header = image[: HEADER.itemsize].view(HEADER)
    header["crc32"] = lib.crp_image_crc(ffi.from_buffer("uint8_t[]", image), len(image))
