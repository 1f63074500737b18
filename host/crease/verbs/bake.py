"""`crease bake`: two meshes in, one scene image out."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from crease.base.errors import MeshError, UsageError
from crease.base.progress import Forecast, Progress
from crease.base.table import bytes_writer, check_suffix, check_target, claim, write_together
from crease.base.units import format_length, unit_name
from crease.verbs.common import (
    SubParsers,
    add_force,
    add_json,
    add_mesh_options,
    add_unit,
    length,
    metres,
    print_json,
    print_lines,
    size,
    unit,
    warn,
)

if TYPE_CHECKING:
    from crease.bake.bake import BakeOptions
    from crease.mesh.mesh import Mesh


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "bake",
        help="make a scene image from a static mesh and a tool mesh",
        description="Make a scene image from two meshes (STL, OBJ, PLY, OFF, GLB; STEP with the extra `step`).",
    )
    parser.add_argument("static", metavar="STATIC", type=Path, help="mesh of the mock-up")
    parser.add_argument("tool", metavar="TOOL", type=Path, help="mesh of the tool")
    parser.add_argument(
        "-o",
        "--output",
        metavar="SCENE.crs",
        type=Path,
        required=True,
        help="the image; its meshes go beside it, SCENE.crs.glb",
    )
    add_unit(parser)
    parser.add_argument(
        "--tool-unit",
        metavar="UNIT",
        type=unit,
        help="of TOOL, when it has another one; lengths need a unit then",
    )
    parser.add_argument(
        "--voxel",
        metavar="LENGTH",
        type=length,
        help="side of a voxel, such as 2mm; bare: in --unit (default: the spacing, 1/600 of STATIC or more)",
    )
    parser.add_argument(
        "--spacing",
        metavar="LENGTH",
        type=length,
        help="distance between samples of the tool (default: 1/30 of its middle size, at most about 20,000 samples)",
    )
    add_mesh_options(parser, " (default: refuse them, or leave them out beside solids)")
    parser.add_argument(
        "--tolerance",
        metavar="LENGTH",
        type=length,
        help="refine until the distance error near the surface is below this (default: 1/4 voxel)",
    )
    parser.add_argument(
        "--depth-max",
        metavar="LENGTH",
        type=length,
        help="how far the tool goes into STATIC: what lies deeper is kept roughly, for a smaller image",
    )
    parser.add_argument(
        "--even",
        action="store_true",
        help="cut TOOL by area alone, whatever its triangles: for a tool that is held (replay --couple)",
    )
    parser.add_argument(
        "--chord",
        metavar="LENGTH",
        type=length,
        help="how far triangles may lie from the surfaces of STEP files (default: 0.02mm)",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="refuse meshes that have to be mended, and a tolerance that was not reached",
    )
    parser.add_argument(
        "--image-max",
        metavar="SIZE",
        type=size,
        help="choose voxels for an image of at most this size, such as 1.87MiB",
    )
    parser.add_argument(
        "--memory-max",
        metavar="SIZE",
        type=size,
        help="refuse work that takes more memory (default: half of this machine's)",
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for meshes that cannot be mended, or an output that cannot be written."""
    from crease.bake.bake import bake_scene
    from crease.bake.bodies import pack_bodies
    from crease.base.scene import meshes_path

    check_suffix(args.output, (".crs",))
    check_bare(args)
    check_chord(args)
    bodies = meshes_path(args.output)
    with claim(args.output):
        check_target(args.output, args.force, (args.static, args.tool))
        check_target(bodies, args.force)
        start_s = time.monotonic()
        with Progress() as progress:
            work = Forecast(progress, heard=progress.live)
            static, tool = read_meshes(args, work.prepare)
            warnings = [*static.warnings, *tool.warnings, *unit_warning(static, tool)]
            warn(warnings)
            result = bake_scene(static, tool, bake_options(args), work)
        if args.strict and result.warnings:
            warn(result.warnings[1:])
            raise MeshError(f"{result.warnings[0]}; --strict refuses that")
        warn(result.warnings)
        data = {bodies: pack_bodies(static, tool), args.output: result.image}
        write_together({path: bytes_writer(part) for path, part in data.items()})
    report = {
        "output": str(args.output),
        "meshes": str(bodies),
        "warnings": [*warnings, *result.warnings],
        "time_s": round(time.monotonic() - start_s, 3),
        **describe(result.image, str(args.output)),
        "bake": result.report,
    }
    if args.json:
        print_json(report)
    else:
        print_report(report)


LENGTHS = ("voxel", "spacing", "sheet", "tolerance", "depth_max", "chord")
"""Options that are lengths."""


def check_bare(args: argparse.Namespace) -> None:
    """Errors: UsageError for a length without a unit where STATIC and TOOL have different ones."""
    if args.tool_unit in (None, args.unit):
        return
    one, two = unit_name(args.unit), unit_name(args.tool_unit)
    for name in LENGTHS:
        option = getattr(args, name)
        if option and option(1.0) != option(2.0):
            text = f"{option(1.0):g}"
            raise UsageError(
                f"--{name.replace('_', '-')} {text}: the two meshes have different units; write {text}{one} or "
                f"{text}{two}"
            )


def check_chord(args: argparse.Namespace) -> None:
    """Errors: UsageError for --chord where neither mesh is cut from curved surfaces."""
    from crease.mesh.mesh import STEP

    if args.chord and not any(path.suffix.lower() in STEP for path in (args.static, args.tool)):
        raise UsageError("--chord is of STEP files, and neither mesh is one; leave it out")


TOOL_LARGER, TOOL_SMALLER = 5.0, 100.0
"""Times as long as the mock-up, or as short: few tools are, many are in another unit."""


def unit_warning(static: Mesh, tool: Mesh) -> list[str]:
    """A warning when one body is so much larger than the other that its unit is most likely another one."""
    import numpy as np

    static_m, tool_m = (float(np.ptp(mesh.vertices_m, axis=0).max()) for mesh in (static, tool))
    ratio = tool_m / static_m
    if 1.0 / TOOL_SMALLER <= ratio <= TOOL_LARGER:
        return []
    how = f"{ratio:.0f} times as long" if ratio > 1.0 else f"{1.0 / ratio:.0f} times as short"
    return [
        f"{tool.source}: the tool is {format_length(tool_m)} long, {how} as the mock-up, {format_length(static_m)}; "
        "if that is wrong, give its unit with --tool-unit, the mock-up's with --unit"
    ]


def read_meshes(
    args: argparse.Namespace, progress: Callable[[str, float], None]
) -> tuple[Mesh, Mesh]:
    """STATIC and TOOL of the command line.   Errors: MeshError."""
    from crease.mesh.mesh import CHORD_M, load_mesh

    sheet_m, chord_m = metres(args.sheet, args.unit), metres(args.chord, args.unit)

    def read(path: Path, unit_m: float) -> Mesh:
        return load_mesh(
            path, unit_m, progress, sheet_m=sheet_m, strict=args.strict, chord_m=chord_m or CHORD_M
        )

    return read(args.static, args.unit), read(args.tool, args.tool_unit or args.unit)


def bake_options(args: argparse.Namespace) -> BakeOptions:
    """The options of the command line, bare numbers in the unit of STATIC."""
    from crease.bake.bake import BakeOptions

    return BakeOptions(
        voxel_m=metres(args.voxel, args.unit),
        spacing_m=metres(args.spacing, args.unit),
        crease_angle_deg=args.crease_angle,
        tolerance_m=metres(args.tolerance, args.unit),
        memory_max_bytes=args.memory_max,
        image_max_bytes=args.image_max,
        depth_max_m=metres(args.depth_max, args.unit),
        even=args.even,
    )


def describe(image: bytes, source: str) -> dict[str, object]:
    """What the image says of itself, through the firmware's parser."""
    from crease.base.scene import open_image

    return open_image(image, source).info()


def print_report(report: dict[str, object]) -> None:
    """The bake in a few lines for a person."""
    from crease.verbs.info import size_text

    static, voxmap, tool = report["static"], report["voxmap"], report["tool"]
    assert isinstance(static, dict)
    assert isinstance(voxmap, dict)
    assert isinstance(tool, dict)
    print_lines(
        [
            ("scene", f"{report['output']}, {size_text(report['image_bytes'])}"),
            ("meshes", f"{report['meshes']}, for `crease view`"),
            ("triangles", f"{static['triangles']:,} static, {tool['triangles']:,} tool"),
            ("creases", f"{static['convex_edges']:,} convex, {static['concave_edges']:,} concave"),
            ("voxel", format_length(voxmap["voxel_m"])),
            ("samples", f"{tool['points']:,}, {format_length(tool['spacing_m'])} apart"),
            (
                "distance error",
                f"{format_length(voxmap['error_max_m'])} max, {format_length(voxmap['error_rms_m'])} RMS",
            ),
            ("time", f"{report['time_s']:.1f} s"),
        ]
    )
