"""Meshes from files: read with their unit, checked, mended where that is safe, refused where it is not."""

from __future__ import annotations

import codecs
import hashlib
import io
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.arguments import check_positive
from crease.base.ending import undone_by
from crease.base.errors import MeshError, UnitError
from crease.base.settings import setting
from crease.base.table import describe
from crease.base.units import METRES, format_length, parse_unit
from crease.mesh.draft import Wishes
from crease.mesh.glb import check_glb, glb_lacks, unsaid
from crease.mesh.mend import mend_surface
from crease.mesh.polygons import WITH_POLYGONS, parse_off, unfold
from crease.mesh.texts import STL_HEAD, STL_TRIANGLE, check_whole, is_binary_stl, stumble

STEP = (".step", ".stp")
SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", *STEP)
"""Formats that are read; STEP with the extra of that name."""

OBJ_ZERO = re.compile(rb"^[ \t]*f[ \t](?:[^\n]*[ \t])?0+(?:[/ \t\r]|$)", re.MULTILINE)
"""A face of an OBJ with a vertex 0: its reader takes it for the last one."""

UNEXPECTED = {"PLY is unexpected length!": "it is not as long as its head says"}
"""What a reader says, and what a person understands."""

CHORD_M = 2e-5
"""How far triangles may lie from the curved surfaces of a STEP file."""
CHORD_ANGLE_RAD = 0.2
"""How far neighbours of them may turn."""

TRIANGLES_MAX = 20_000_000
SIZE_MIN_M, SIZE_MAX_M = 1e-3, 100.0
"""A box diagonal outside is refused as a wrong unit."""

FAR_M = 1000.0
"""Coordinates beyond are refused: single precision, which images have, keeps 0.1 mm of them."""

LIKELY_MIN_M, LIKELY_MAX_M = 5e-3, 10.0
"""A box diagonal outside gets a warning."""


@dataclass(frozen=True)
class Mesh:
    """A closed, consistently oriented surface of positive volume.

    Shapes: vertices_m float64 (n, 3) in metres; triangles int32 (m, 3), counter-clockwise seen from outside.
    """

    vertices_m: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int32]
    digest_sha256: str
    source: str
    warnings: tuple[str, ...] = ()
    unit_m: float = 1.0

    def __repr__(self) -> str:
        size = " x ".join(format_length(float(side)) for side in np.ptp(self.vertices_m, axis=0))
        counts = f"{len(self.vertices_m)} vertices, {len(self.triangles)} triangles"
        return f"Mesh({self.source!r}: {counts}, {size})"


def load_mesh(
    path: str | Path,
    unit: str | float,
    progress: Callable[[str, float], None] = lambda _label, _part: None,
    *,
    sheet_m: float | None = None,
    strict: bool = False,
    chord_m: float = CHORD_M,
) -> Mesh:
    """Read, scale, check and mend a mesh file: STL, OBJ, PLY, OFF, GLB; STEP with the package cascadio.

    unit: of the file's coordinates, by name (nm, um, mm, cm, dm, m, in, ft) or as metres. progress: called with what is
    done and the part of it that is, 0..1. sheet_m: how thick open sheets are made; None: they are left out or refused.
    strict: refuse what has to be mended. chord_m: how far triangles may lie from the surfaces of a STEP file, which
    carries its own unit.
    Output: warnings tell every mend with its counts, each beginning with the file.
    Errors: MeshError for what cannot be read or mended, UnitError for a unit that is none; the text says what and the
    mend.
    Cost: 6 s and 1 GB for a million triangles of STL.
    """
    try:
        path = Path(path)
    except TypeError as error:
        raise MeshError(
            f"path is a {type(path).__name__}; give the path of a mesh file, or arrays to make_mesh"
        ) from error
    if not isinstance(unit, str):
        check_positive("unit", unit, "a name such as 'mm', or a number of metres", UnitError)
    unit_m = parse_unit(unit) if isinstance(unit, str) else unit
    label = f"reading {path.name}"
    progress(label, 0.0)
    source = _read_bytes(path)
    digest = hashlib.sha256(source).hexdigest()
    vertices, triangles = _parse_whole(path, source, unit_m, chord_m)
    del source
    return make_mesh(
        vertices,
        triangles,
        unit_m,
        source=str(path),
        digest_sha256=digest,
        progress=lambda part: progress(label, 0.3 + 0.7 * part),
        sheet_m=sheet_m,
        strict=strict,
    )


def make_mesh(
    vertices: npt.ArrayLike,
    triangles: npt.ArrayLike,
    unit_m: float = 1.0,
    *,
    source: str = "mesh",
    digest_sha256: str | None = None,
    progress: Callable[[float], None] = lambda _part: None,
    sheet_m: float | None = None,
    strict: bool = False,
) -> Mesh:
    """A mesh from arrays (n, 3) and (m, 3), with the same checks and mends as a file; options as for load_mesh.

    unit_m: m per unit of the mesh, finite and above 0.
    Errors: MeshError, also for a unit_m that is none: a unit's name is for load_mesh.
    """
    check_positive(
        f"{source}: unit_m",
        unit_m,
        "a finite number, m per unit of the mesh (0.001 for mm),",
        MeshError,
    )
    points = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    _check_numbers(points, corners, source)
    if digest_sha256 is None:
        digest = hashlib.sha256(np.ascontiguousarray(points).tobytes())
        digest.update(np.ascontiguousarray(corners).tobytes())
        digest_sha256 = digest.hexdigest()
    vertices_m = points * unit_m
    hint = _check_size(vertices_m[corners.reshape(-1)], unit_m, source)
    try:
        wishes = Wishes(unit_m, sheet_m)
        vertices_m, faces, notes = mend_surface(
            vertices_m, corners.astype(np.int32), progress, wishes
        )
    except MeshError as error:
        raise MeshError(f"{source}: {error}") from error
    if strict and notes:
        raise MeshError(
            f"{source}: {notes[0]}; {setting('strict', True)} refuses what has to be mended"
        )
    warnings = tuple(f"{source}: {note}" for note in (*hint, *notes))
    return Mesh(vertices_m, faces, digest_sha256, source, warnings, unit_m)


def _read_bytes(path: Path) -> bytes:
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: meshes are read from {', '.join(SUFFIXES)}; convert it")
    try:
        source = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}") from error
    if not source:
        raise MeshError(f"{path}: is an empty file; export it again")
    return source


def read_arrays(path: Path, unit_m: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Vertices (n, 3) in units of `unit_m` and triangles (m, 3) as they stand in a file.   Errors: MeshError."""
    vertices, triangles = _parse_whole(path, _read_bytes(path), unit_m, CHORD_M)
    points = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    _check_numbers(points, corners, str(path))
    return points, corners


def _parse_whole(
    path: Path, source: bytes, unit_m: float, chord_m: float
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    source = _plain(path, source)
    check_whole(path, source)
    if path.suffix.lower() == ".glb":
        check_glb(path, source)
    if path.suffix.lower() not in STEP:
        return _parse(path, source)
    vertices_m, triangles = _parse(path.with_suffix(".glb"), _tessellate(path, chord_m))
    return vertices_m / unit_m, triangles


def _plain(path: Path, source: bytes) -> bytes:
    """Text as its readers know it: UTF-8 without a mark, and lines that end as they do here.

    Names and comments in another encoding lose their letters: nothing of the surface is in them.
    """
    if path.suffix.lower() == ".ply":
        head, end, body = source.partition(b"end_header")
        return head.decode(errors="replace").encode() + end + body if end else source
    if path.suffix.lower() not in (".stl", ".obj", ".off") or is_binary_stl(source):
        return source
    if source.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        source = source.decode("utf-16", errors="replace").encode()
    source = source.removeprefix(codecs.BOM_UTF8)
    if b"\0" in source:
        return source
    if not source.isascii():
        source = source.decode(errors="replace").encode()
    return source if b"\n" in source else source.replace(b"\r", b"\n")


@contextmanager
def _silent() -> Iterator[None]:
    """Within this nothing is said on stdout and stderr, by libraries of C++ either."""
    kept = [os.dup(number) for number in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in (1, 2):
            os.dup2(nowhere, number)
        yield
    finally:
        for number, stream in zip((1, 2), kept, strict=True):
            os.dup2(stream, number)
        for stream in (*kept, nowhere):
            os.close(stream)


def _tessellate(path: Path, chord_m: float) -> bytes:
    """The solids of a STEP file as GLB, in metres.   Errors: MeshError."""
    try:
        import cascadio
    except ImportError:
        raise MeshError(
            f"{path}: STEP is read with an extra; run pip install 'crease[step]', or convert it"
        ) from None
    with (
        tempfile.TemporaryDirectory() as folder,
        undone_by(partial(shutil.rmtree, folder)),
    ):
        made = Path(folder) / "made.glb"
        try:
            with _silent():
                status = cascadio.step_to_glb(str(path), str(made), chord_m * 1e3, CHORD_ANGLE_RAD)
        except Exception as error:  # whatever the reader makes of a damaged file
            raise MeshError(f"{path}: cannot be read as STEP: {describe(error)[:160]}") from error
        if status != 0 or not made.exists():
            raise MeshError(f"{path}: cannot be read as STEP; export it again")
        return made.read_bytes()


def _parse_binary_stl(source: bytes) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """As trimesh reads it, in a tenth of the time."""
    count = int.from_bytes(source[80:84], "little")
    whole = np.frombuffer(source, STL_TRIANGLE, count, STL_HEAD)
    corners = whole["corners"].reshape(-1, 3)
    with np.errstate(all="ignore"):  # numbers that are none are refused by who asks for these
        return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)


def _parse(path: Path, source: bytes) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Vertices and triangles as the file has them, polygons cut into triangles."""
    vertices, triangles = _parse_fans(path, source)
    if path.suffix.lower() in WITH_POLYGONS and np.isfinite(vertices).all():
        return vertices, unfold(vertices, triangles)
    return vertices, triangles


def _parse_fans(path: Path, source: bytes) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Vertices and triangles as the file has them, polygons cut into fans."""
    if path.suffix.lower() == ".stl" and is_binary_stl(source):
        return _parse_binary_stl(source)
    import trimesh

    kind = path.suffix.lower()[1:]
    try:
        if kind == "off":
            return parse_off(source.decode("latin-1"))
        if kind == "obj" and OBJ_ZERO.search(source):
            raise ValueError("a face names vertex 0, the first is 1")
        with np.errstate(all="ignore"), unsaid():  # numbers that are none: refused by who asks
            scene = trimesh.load_scene(
                io.BytesIO(source), file_type=kind, process=False, skip_materials=True
            )
            mesh = scene.to_mesh()
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except MemoryError:
        raise MeshError(f"{path}: does not fit into memory; reduce its triangles") from None
    except (
        Exception
    ) as error:  # the readers of the formats raise whatever a damaged file leads them to
        if kind == "glb":
            raise MeshError(f"{path}: is {glb_lacks(source)}; copy or export it again") from error
        reason = stumble(path.suffix.lower(), source) or UNEXPECTED.get(
            str(error), describe(error)[:160]
        )
        if isinstance(error, ImportError):
            reason = "is damaged"  # a reader that does not know what it sees asks for packages
        raise MeshError(
            f"{path}: cannot be read as {path.suffix}: {reason}; export it again"
        ) from error


def _check_numbers(
    vertices: npt.NDArray[np.float64], triangles: npt.NDArray[np.int64], source: str
) -> None:
    """Refuse what is empty, huge or not numbers."""
    if len(triangles) == 0:
        raise MeshError(f"{source}: has no triangles; export the surface, not points or curves")
    if len(triangles) > TRIANGLES_MAX:
        raise MeshError(
            f"{source}: has {len(triangles):,} triangles, more than {TRIANGLES_MAX:,}; reduce it"
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"{source}: a triangle names a vertex that is not there; export it again")
    used = np.zeros(len(vertices), bool)
    used[triangles] = True
    bad = np.flatnonzero(used & ~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{source}: {len(bad):,} of {len(vertices):,} vertices are not finite numbers, the first is vertex "
            f"{bad[0]}; export it again"
        )


def _likely_units(diagonal: float) -> str:
    """Units that would give a box of a likely size, for a diagonal in file units."""
    fits = [
        f"{name} ({format_length(diagonal * METRES[name])})"
        for name in ("mm", "cm", "in", "m", "um")
        if LIKELY_MIN_M <= diagonal * METRES[name] <= LIKELY_MAX_M
    ]
    return " or ".join(fits[:2])


def _check_size(points_m: npt.NDArray[np.float64], unit_m: float, source: str) -> list[str]:
    """Refuse a box that no tool or mock-up has; warn of one that few have."""
    diagonal_m = math.hypot(*np.ptp(points_m, axis=0))
    if diagonal_m == 0.0:
        raise MeshError(f"{source}: all vertices are one point; export it again")
    likely = _likely_units(diagonal_m / unit_m)
    mend = f"try {setting('unit')} {likely}" if likely else "check the unit and the export"
    if not SIZE_MIN_M <= diagonal_m <= SIZE_MAX_M:
        raise MeshError(
            f"{source}: is {format_length(diagonal_m)} across in this unit, outside 1 mm..100 m; {mend}"
        )
    away_m = float(np.abs(points_m).max())
    if away_m > FAR_M:
        raise MeshError(
            f"{source}: lies {format_length(away_m)} from its origin, more than 1 km; move it there and export it again"
        )
    if not LIKELY_MIN_M <= diagonal_m <= LIKELY_MAX_M:
        return [f"is {format_length(diagonal_m)} across in this unit; if that is wrong, {mend}"]
    return []
