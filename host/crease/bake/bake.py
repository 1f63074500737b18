"""`bake`: two meshes become one scene image. features -> voxmap, shell -> image."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.distance_errors import measure_errors
from crease.bake.estimate import foresee_features, foresee_shell, foresee_voxmap
from crease.bake.layout import EDGE, META, PAIR, pack
from crease.bake.limits import check_grid, check_spacing, up_to_two_digits
from crease.bake.shell import Shell, make_shell
from crease.bake.surface import Surface, flatten, join_narrow, make_surface
from crease.bake.voxmap import Voxmap, make_voxmap
from crease.base.arguments import default_memory_max
from crease.base.errors import MeshError
from crease.base.native import lib
from crease.base.progress import Forecast
from crease.base.settings import setting
from crease.base.units import format_length, format_size
from crease.mesh.mesh import Mesh

__all__ = ["BakeOptions", "BakeResult", "bake_scene"]

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class BakeOptions:
    """What the user may choose; None means sensible from the sizes."""

    voxel_m: float | None = None
    spacing_m: float | None = None
    crease_angle_deg: float = 30.0
    tolerance_m: float | None = None
    memory_max_bytes: int | None = None
    image_max_bytes: int | None = None
    depth_max_m: float | None = None
    even: bool = False
    """Pieces of the tool are cut by area alone, whatever its triangles: for a tool that is held (firmware/couple)."""


@dataclass(frozen=True)
class BakeResult:
    """A scene image, what making it found, and what the user should know of it."""

    image: bytes
    report: dict[str, object]
    warnings: tuple[str, ...] = ()


TARGET_SHARE = 4 / 7
"""Share of the tolerance at which refining aims: it looks at points half a voxel apart, errors peak between them."""
FLAT_SHARE = 0.5
"""Share of the tolerance that a patch may be off one plane as a whole, and is taken for it."""
NEAR_SHARE = 0.75
"""Distance up to which samples are covered, in spacings, before a shell tells it; for the estimate of the time only."""
TRIES_MAX = 8
"""Voxel sizes that are tried for an image that fits."""
NOISE_TRIANGLES = 300
NOISE_SHARE = 0.05
"""Creases that end within a smooth patch over this share of the edges: noise, not design."""


@dataclass(frozen=True)
class _Sizes:
    """Lengths in m that a bake works with; target: at which refining aims."""

    voxel_m: float
    spacing_m: float
    tolerance_m: float
    target_m: float
    tool_m: float
    """The longest side of the tool: no spacing is larger."""


def _forecast(progress: Progress | None) -> Forecast:
    if progress is None:
        return Forecast(heard=False)
    return Forecast(lambda label, part, _left_s: progress(label, part))


def default_spacing_m(tool: Mesh) -> float:
    """A thirtieth of the tool's middle size, coarser when that made over 20,000 samples."""
    size = np.sort(np.ptp(tool.vertices_m, axis=0))
    v = tool.vertices_m[tool.triangles]
    area = 0.5 * np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1).sum()
    return _rounded(max(float(size[1]) / 30, math.sqrt(float(area) / 20_000)))


def default_voxel_m(static: Mesh, spacing_m: float) -> float:
    """The spacing of the shell, coarser when the static object were over 600 voxels long."""
    size = np.ptp(static.vertices_m, axis=0)
    return _rounded(max(spacing_m, float(size.max()) / 600))


def _rounded(value: float) -> float:
    """Two significant digits."""
    return float(f"{value:.1e}")


def _sizes(options: BakeOptions, static: Mesh, tool: Mesh) -> _Sizes:
    spacing = default_spacing_m(tool) if options.spacing_m is None else options.spacing_m
    voxel = default_voxel_m(static, spacing) if options.voxel_m is None else options.voxel_m
    tolerance = voxel / 4 if options.tolerance_m is None else options.tolerance_m
    chosen = [("spacing_m", spacing), ("voxel_m", voxel), ("tolerance_m", tolerance)]
    chosen += [] if options.depth_max_m is None else [("depth_max_m", options.depth_max_m)]
    for name, value in chosen:
        if not (math.isfinite(value) and value > 0):
            raise MeshError(f"{setting(name)} is {value}: must be a positive length")
    for name, value, body, mesh in (
        ("spacing_m", spacing, "tool", tool),
        ("voxel_m", voxel, "mock-up", static),
    ):
        span = float(np.ptp(mesh.vertices_m, axis=0).max())
        if value > span:
            usual = default_spacing_m(tool)
            usual = usual if body == "tool" else default_voxel_m(static, usual)
            # A tool that is large beside the mock-up: the default is what is too large.
            such = (
                f"{format_length(usual)}, the default"
                if usual <= span
                else format_length(_rounded(span / 30))
            )
            raise MeshError(
                f"{setting(name, value)} is larger than the {body} ({format_length(span)}): use a smaller one, "
                f"such as {such}"
            )
    tool_m = float(np.ptp(tool.vertices_m, axis=0).max())
    return _sizes_at(voxel, spacing, tool_m, options)


def _sizes_at(voxel_m: float, spacing_m: float, tool_m: float, options: BakeOptions) -> _Sizes:
    tolerance_m, target_m = voxel_m / 4, voxel_m / 7
    if options.tolerance_m:
        tolerance_m, target_m = options.tolerance_m, TARGET_SHARE * options.tolerance_m
    return _Sizes(voxel_m, spacing_m, tolerance_m, target_m, tool_m)


def noise_warning(surface: Surface, crease_angle_deg: float) -> list[str]:
    """What is said of a static mesh whose creases are noise: an edge that turns sharply and leads nowhere."""
    creases, triangles = surface.creases, len(surface.mesh.triangles)
    edges = sum(surface.counts[f"{name}_edges"] for name in ("smooth", "convex", "concave"))
    count = len(creases.convex)
    loose = int(np.count_nonzero(creases.patch[:, 0] == creases.patch[:, 1]))
    if triangles < NOISE_TRIANGLES or loose < NOISE_SHARE * edges:
        return []
    for angle in (45.0, 60.0, 75.0, 90.0):
        left = int(np.count_nonzero(creases.angle_rad >= math.radians(angle)))
        if angle > crease_angle_deg and left < 0.1 * count:
            break
    now, better = (setting("crease_angle_deg", given) for given in (crease_angle_deg, angle))
    return [
        f"{surface.mesh.source}: {count:,} of {edges:,} edges are sharper than {now}, and {loose:,} of them lead "
        f"nowhere: this looks like noise; {better} leaves {left:,}, or smooth the mesh"
    ]


FAR_SHARE = 1e-3
"""Of a voxel: a step of single precision that is larger is worth a warning."""


def far_warning(mesh: Mesh, voxel_m: float) -> list[str]:
    """What is said of a mesh so far from its origin that single precision, in which the core counts, is coarse."""
    away_m = float(np.abs(mesh.vertices_m).max())
    step_m = away_m * 2.0**-24
    if step_m <= FAR_SHARE * voxel_m:
        return []
    return [
        f"{mesh.source}: lies up to {format_length(away_m)} from the origin, where positions are off by up to "
        f"{format_length(step_m)}, over 1/{1.0 / FAR_SHARE:.0f} of a voxel of {format_length(voxel_m)}: the force "
        "comes in steps; move the mesh to the origin, and the path with it"
    ]


def _pairs(surface: Surface) -> npt.NDArray[Any]:
    sides = np.sort(surface.creases.patch, axis=1)
    label = np.where(surface.creases.convex, lib.CR_PAIR_CONVEX, lib.CR_PAIR_CONCAVE)
    apart = sides[:, 0] != sides[:, 1]
    keys, inverse = np.unique(sides[apart], axis=0, return_inverse=True)
    bits = np.zeros(len(keys), np.int64)
    np.bitwise_or.at(bits, inverse.reshape(-1), label[apart])
    out = np.zeros(len(keys), PAIR)
    out["first"], out["second"] = (keys[:, 0], keys[:, 1]) if len(keys) else (0, 0)
    out["label"] = bits
    return out


def _edges(surface: Surface) -> npt.NDArray[Any]:
    creases = surface.creases
    out = np.zeros(len(creases.convex), EDGE)
    out["a_m"], out["b_m"] = creases.ends_m[:, 0], creases.ends_m[:, 1]
    out["patch"] = creases.patch
    out["label"] = np.where(creases.convex, lib.CR_PAIR_CONVEX, lib.CR_PAIR_CONCAVE)
    out["angle_rad"] = creases.angle_rad
    return out


def _meta(
    surface: Surface, voxmap: Voxmap, shell: Shell, tool: Mesh, options: BakeOptions
) -> npt.NDArray[Any]:
    meta = np.zeros(1, META)
    grid, static = voxmap.grid, surface.mesh
    values: dict[str, object] = {
        "origin_m": grid.origin_m,
        "brick_m": grid.brick_m,
        "dims": grid.dims,
        "voxel_m": grid.voxel_m,
        "band_m": voxmap.band_m,
        "crease_m": voxmap.crease_m,
        "quantum_m": voxmap.quantum_m,
        "crease_angle_rad": math.radians(options.crease_angle_deg),
        "spacing_m": shell.spacing_m,
        "tool_radius_m": shell.tool_radius_m,
        "root_centre_m": shell.root_centre_m,
        "root_radius_m": shell.root_radius_m,
        "shell_area_m2": shell.area_m2,
        "ramp_max_m": np.float32(shell.ramp_max_m * (1 + 1e-6)),
        "point_count": shell.points,
        "levels": shell.levels,
        "patch_count": surface.counts["patches"],
        "piece_count": shell.pieces,
        "static_triangles": len(static.triangles),
        "tool_triangles": len(tool.triangles),
        "static_unit_m": static.unit_m,
        "tool_unit_m": tool.unit_m,
        "static_sha256": np.frombuffer(bytes.fromhex(static.digest_sha256), np.uint8),
        "tool_sha256": np.frombuffer(bytes.fromhex(tool.digest_sha256), np.uint8),
        "static_min_m": static.vertices_m.min(axis=0),
        "static_max_m": static.vertices_m.max(axis=0),
        "tool_min_m": tool.vertices_m.min(axis=0),
        "tool_max_m": tool.vertices_m.max(axis=0),
        **{
            f"{name}_edges": surface.counts[f"{name}_edges"]
            for name in ("smooth", "convex", "concave")
        },
    }
    for name, value in values.items():
        meta[name] = value
    return meta


def _assemble(
    surface: Surface, voxmap: Voxmap, shell: Shell, meta: npt.NDArray[Any]
) -> npt.NDArray[np.uint8]:
    sections: dict[int, npt.NDArray[Any]] = {
        int(lib.CR_SEC_META): meta,
        int(lib.CR_SEC_TOP): voxmap.top,
        int(lib.CR_SEC_BRICKS): voxmap.bricks,
        int(lib.CR_SEC_SAMPLES): voxmap.samples,
        int(lib.CR_SEC_CELLS): voxmap.cells,
        int(lib.CR_SEC_KINDS): voxmap.kinds,
        int(lib.CR_SEC_FACETS): voxmap.facets,
        int(lib.CR_SEC_PAIRS): _pairs(surface),
        int(lib.CR_SEC_EDGES): _edges(surface),
        int(lib.CR_SEC_CLUSTERS): shell.clusters,
        int(lib.CR_SEC_SUMS): shell.sums,
        int(lib.CR_SEC_GROUPS): shell.groups,
        int(lib.CR_SEC_ADJ_START): shell.adj_start,
        int(lib.CR_SEC_ADJ): shell.adj,
    }
    return pack(sections)


def bake_scene(
    static: Mesh,
    tool: Mesh,
    options: BakeOptions | None = None,
    progress: Progress | Forecast | None = None,
) -> BakeResult:
    """Make the scene image of a static mesh and a tool mesh (closed, metres).

    progress: told what is done and the part of the whole bake that is; a Forecast also what is left, and its stage
    "writing" is left to whoever writes the files.
    Errors: MeshError when the sizes do not fit together, or would take more memory than they may.
    """
    options = options or BakeOptions()
    work = progress if isinstance(progress, Forecast) else _forecast(progress)
    start_s = time.perf_counter()
    memory_max = options.memory_max_bytes or default_memory_max()
    sizes = _sizes(options, static, tool)
    check_spacing(tool, sizes.spacing_m, memory_max)
    check_grid(static, sizes.voxel_m, NEAR_SHARE * sizes.spacing_m, memory_max)
    foresee_features(work, static, tool)
    work.begin("features")
    told = make_surface(static, options.crease_angle_deg)
    surface = join_narrow(flatten(told, FLAT_SHARE * sizes.tolerance_m), sizes.spacing_m)
    tool_surface = make_surface(tool, options.crease_angle_deg)
    foresee_shell(work, tool_surface, sizes.spacing_m)
    if work.heard:
        near_m = max(NEAR_SHARE * sizes.spacing_m, 0.5 * sizes.voxel_m)
        foresee_voxmap(work, surface, sizes.voxel_m, near_m, sizes.target_m)
        work.complete()
    work.begin("shell")
    shell = make_shell(tool_surface, sizes.spacing_m, work.tick, options.even)
    sizes, voxmap, notes = _fitting_voxmap(surface, shell, sizes, options, memory_max, work)
    meta = _meta(surface, voxmap, shell, tool, options)
    image = _assemble(surface, voxmap, shell, meta)
    work.begin("measuring")
    errors = measure_errors(image, surface, voxmap)
    for name, value in errors.items():
        meta[name] = value
    image = _assemble(surface, voxmap, shell, meta)
    for mesh in (static, tool):
        notes += far_warning(mesh, voxmap.grid.voxel_m)
    notes += noise_warning(told, options.crease_angle_deg)
    work.begin("writing")
    if not isinstance(progress, Forecast):
        work.end()
    if errors["error_max_m"] > sizes.tolerance_m:
        notes.append(
            f"the distance error near the surface is {format_length(errors['error_max_m'])}, more than the tolerance "
            f"of {format_length(sizes.tolerance_m)}: refining ends at 1/4 voxel; use a smaller {setting('voxel_m')}"
        )
    return BakeResult(
        image.tobytes(),
        {
            "seconds": round(time.perf_counter() - start_s, 3),
            "image_bytes": len(image),
            "voxel_m": voxmap.grid.voxel_m,
            "spacing_m": sizes.spacing_m,
            "tolerance_m": sizes.tolerance_m,
            **errors,
            "bricks_by_level": voxmap.levels,
            "fine_voxels": voxmap.fine_voxels,
            "cells_by_kind": voxmap.kind_counts,
            "facets": surface.counts["facets"],
            "points": shell.points,
            "clusters": len(shell.clusters),
        },
        tuple(notes),
    )


def _fitting_voxmap(
    surface: Surface,
    shell: Shell,
    sizes: _Sizes,
    options: BakeOptions,
    memory_max: int,
    work: Forecast,
) -> tuple[_Sizes, Voxmap, list[str]]:
    """The voxmap, with voxels as large as it takes to stay within image_max_bytes, and what is said of that."""
    room = options.image_max_bytes
    shell_bytes = _bytes_of(shell.clusters, shell.sums, shell.groups, shell.adj_start, shell.adj)
    if room is not None and 1.05 * shell_bytes > room:
        raise MeshError(
            f"the shell of the tool alone takes {format_size(shell_bytes)} of {setting('image_max_bytes', room)}; "
            f"{_spacing_mend(sizes, shell_bytes, room, 'allow a larger image')}"
        )
    widest, tried, least = sizes, sizes, sys.maxsize
    for attempt in range(TRIES_MAX):
        near_m = max(0.55 * shell.h_max_m, 0.5 * tried.voxel_m)
        if attempt > 0 and work.heard:
            foresee_voxmap(work, surface, tried.voxel_m, near_m, tried.target_m)
        voxmap = make_voxmap(
            surface,
            tried.voxel_m,
            near_m,
            tried.target_m,
            work,
            memory_max,
            depth_max_m=options.depth_max_m,
        )
        rest = _bytes_of(
            voxmap.top, voxmap.bricks, voxmap.samples, voxmap.cells, voxmap.kinds, voxmap.facets
        )
        rest += 40 * len(surface.creases.convex) + 4096
        least = min(least, shell_bytes + rest)
        if room is None or shell_bytes + rest <= room:
            said = (
                f"{setting('image_max_bytes', room or 0)}: voxels of {format_length(tried.voxel_m)} "
                f"instead of {format_length(sizes.voxel_m)}, tolerance {format_length(tried.tolerance_m)}"
            )
            return tried, voxmap, [] if attempt == 0 else [said]
        if attempt == 0:
            # Smaller bricks follow creases with fewer fine samples: half the bytes for the same error.
            tried = replace(sizes, voxel_m=_rounded(0.5 * sizes.voxel_m))
            continue
        if attempt > 1:
            widest = tried
        grow = math.sqrt(max(1.1, rest / (room - shell_bytes)))
        tried = _sizes_at(
            _rounded(1.05 * widest.voxel_m * grow), sizes.spacing_m, sizes.tool_m, options
        )
    raise MeshError(
        f"the image does not get below {format_size(least)}, more than {setting('image_max_bytes', room or 0)}; "
        f"{_spacing_mend(sizes, shell_bytes, room or 1, 'allow that much')}"
    )


def _spacing_mend(sizes: _Sizes, shell_bytes: int, room: int, other: str) -> str:
    """`other`, or the spacing where the shell, were its size as the number of samples, took a quarter of the image."""
    fits_m = up_to_two_digits(sizes.spacing_m * max(math.sqrt(4.0 * shell_bytes / room), 1.1))
    if fits_m > sizes.tool_m:
        span = format_length(sizes.tool_m)
        return f"{other}: no {setting('spacing_m')} fits that is smaller than the tool ({span})"
    return f"{other}, or use a larger {setting('spacing_m')}, such as {format_length(fits_m)}"


def _bytes_of(*parts: npt.NDArray[Any]) -> int:
    return sum(part.nbytes for part in parts)
