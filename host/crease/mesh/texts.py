"""Mesh files before and after their readers: whether one is whole, and on which line a reader stumbled."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from crease.base.errors import MeshError

STL_HEAD = 84
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A binary STL: bytes before its triangles, and one of these."""

BINARY = re.compile(rb"[\0-\x08\x0e-\x1f]")
"""Bytes that no text has, and a binary STL has in each triangle."""

PLURALS = {"vertex": "vertices", "face": "faces"}
WORD_MAX = 40
"""Letters of a word that a message repeats."""


def is_binary_stl(source: bytes) -> bool:
    """Whether it holds as many triangles as it says, whatever follows: letters of a text would say over 500 million."""
    count = int.from_bytes(source[80:84], "little")
    return count > 0 and len(source) >= STL_HEAD + STL_TRIANGLE.itemsize * count


def check_whole(path: Path, source: bytes) -> None:
    """Errors: MeshError for an STL or a PLY in text that ends before its last triangle."""
    suffix = path.suffix.lower()
    if suffix in (".obj", ".off") and is_binary_stl(source) and BINARY.search(source):
        raise MeshError(f"{path}: is no {suffix[1:].upper()} but a binary STL; name it .stl")
    if suffix == ".stl" and _is_empty_stl(source):
        raise MeshError(f"{path}: has no triangles; export the surface, not points or curves")
    lacks = _stl_lacks(source) if suffix == ".stl" else ""
    if suffix == ".ply":
        lacks = _ply_lacks(source)
    if lacks:
        raise MeshError(f"{path}: is {lacks}; copy or export it again")


def _is_empty_stl(source: bytes) -> bool:
    """Whether it is a whole STL in text without a facet."""
    text = source.lower()
    return text.lstrip().startswith(b"solid") and b"endsolid" in text and b"facet" not in text


def _stl_lacks(source: bytes) -> str:
    """What of an STL is not there, empty when all is."""
    if is_binary_stl(source):
        return ""
    start = source.lstrip()[:2000].lower()
    if start.startswith(b"solid") and b"facet" in start:
        whole = b"endsolid" in source.rstrip()[-2000:].lower()
        return "" if whole else "cut off: it does not end with endsolid"
    if len(source) < STL_HEAD:
        return f"cut off: {len(source)} bytes are less than the head of an STL"
    if not BINARY.search(source[:2000]):
        return "a text, but no STL: it does not begin with solid and a facet"
    count = int.from_bytes(source[80:84], "little")
    held = (len(source) - STL_HEAD) // STL_TRIANGLE.itemsize
    return f"cut off: it holds {held:,} of {count:,} triangles" if held < count else ""


def _ply_lacks(source: bytes) -> str:
    """What of a PLY is not there, empty when all is, or when it is binary: its reader knows the length then."""
    head, end, body = source.partition(b"end_header")
    if not head.startswith(b"ply"):
        return ""
    if not end:
        return "cut off: its head does not end with end_header"
    if not re.search(rb"^format\s+ascii", head, re.MULTILINE):
        return ""
    rows = [line for line in body.splitlines() if line.strip()]
    left = len(rows)
    elements = re.findall(rb"^element\s+(\w+)\s+(\d+)\s*$", head, re.MULTILINE)
    for name, wanted in elements:
        if left < int(wanted):
            kind = name.decode("latin-1")
            return f"cut off: it holds {left:,} of {int(wanted):,} {PLURALS.get(kind, kind)}"
        left -= int(wanted)
    if rows and left == 0 and elements[-1][0] == b"face" and _is_short(rows[-1].split()):
        return "cut off: its last face has fewer vertices than it says"
    return ""


def _is_short(face: list[bytes]) -> bool:
    """Whether a face of a PLY, a count and then its vertices, has fewer than it counts."""
    return face[0].isdigit() and len(face) <= int(face[0])


def stumble(suffix: str, source: bytes) -> str:
    """Where and why a reader of text stumbles: `line 12: 'abc' is not a number`. Empty when nothing is found.

    Slow: for error reports.
    """
    find = {".stl": _in_stl, ".obj": _in_obj, ".off": _in_numbers, ".ply": _in_numbers}.get(suffix)
    binary = is_binary_stl(source) if suffix == ".stl" else b"\0" in source
    if find is None or binary:
        return ""
    for number, reason in find(source.decode("latin-1")):
        return f"line {number}: {reason}"
    return ""


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that has words beside a comment."""
    for number, line in enumerate(text.splitlines(), start=1):
        if words := line.split("#", 1)[0].split():
            yield number, words


def _no_number(words: list[str]) -> str:
    """What is wrong with the first word that is no number, empty when all are."""
    for word in words:
        try:
            float(word)
        except ValueError:
            comma = ": it has a decimal comma" if re.fullmatch(r"-?\d+,\d+", word) else ""
            return f"'{word[:WORD_MAX]}' is not a number{comma}"
    return ""


def _no_place(words: list[str]) -> str:
    """What is wrong with the coordinates of a vertex."""
    if len(words) < 3:
        return f"a vertex has {len(words)} numbers, not 3"
    return _no_number(words[:3])


def _in_stl(text: str) -> Iterator[tuple[int, str]]:
    corners = 0
    for number, words in _rows(text.lower()):
        if words[0] == "vertex":
            corners += 1
            if reason := _no_place(words[1:]):
                yield number, reason
        elif words[0] == "endfacet":
            if corners != 3:
                yield number, f"a facet has {corners} vertices, not 3"
            corners = 0


def _in_obj(text: str) -> Iterator[tuple[int, str]]:
    rows = list(_rows(text))
    count = sum(1 for _, words in rows if words[0] == "v")
    for number, words in rows:
        if words[0] == "v" and (reason := _no_place(words[1:])):
            yield number, reason
        for word in words[1:] if words[0] == "f" else ():
            corner = word.split("/", 1)[0]
            if not re.fullmatch(r"-?\d+", corner):
                yield number, f"'{word[:WORD_MAX]}' is not the number of a vertex"
            elif not 1 <= abs(int(corner)) <= count:
                there = "the first is 1" if int(corner) == 0 else f"there are {count:,}"
                yield number, f"a face names vertex {corner}, {there}"


def _in_numbers(text: str) -> Iterator[tuple[int, str]]:
    """Of OFF and PLY, whose bodies are numbers alone."""
    rows = list(_rows(text))
    first = rows[0][1][0].upper() if rows else ""
    ends = [k for k, (_, words) in enumerate(rows) if words[0] == "end_header"]
    start = 1 if first.endswith("OFF") else ends[0] + 1 if ends else len(rows)
    for number, words in rows[start:]:
        if reason := _no_number(words):
            yield number, reason
