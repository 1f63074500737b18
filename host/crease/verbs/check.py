"""`crease check`: a report on mesh files, and a picture with the places marked."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from crease.base.errors import CreaseError, MeshError
from crease.base.table import check_suffix, check_target
from crease.base.units import format_coordinates, format_length, format_place, unit_name
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
)

if TYPE_CHECKING:
    from crease.bake.check import Findings


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "check",
        help="report on meshes: closed, crossings, walls, edges, what `bake` would do",
        description="Report on mesh files without baking them. Exit status 1 when one of them cannot be read or "
        "would be refused, after the report on all.",
    )
    parser.add_argument("meshes", metavar="MESH", type=Path, nargs="+", help="mesh file")
    add_unit(parser)
    parser.add_argument(
        "--voxel", metavar="LENGTH", type=length, help="say whether walls are thicker than this"
    )
    add_mesh_options(parser)
    parser.add_argument(
        "-o", "--output", metavar="PNG", type=Path, help="a picture of what was found"
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for what cannot be read or would be refused, after the whole report."""
    from crease.bake.check import examine
    from crease.draw.findings import draw_findings

    if args.output is not None:
        check_suffix(args.output, (".png",))
        check_target(args.output, args.force)
    sheet_m, voxel_m = metres(args.sheet, args.unit), metres(args.voxel, args.unit)
    findings: list[Findings] = []
    unread: list[str] = []
    lines: list[tuple[str, str]] = []
    for path in args.meshes:
        try:
            one = examine(path, args.unit, args.crease_angle, sheet_m, voxel_m)
        except MeshError as error:
            unread.append(str(error))
            lines.append(("unread", str(error)))
        else:
            findings.append(one)
            lines += rows(one, voxel_m)
    if len(unread) == len(args.meshes) == 1:
        raise CreaseError(unread[0])
    if args.json:
        print_json({"meshes": [one.report() for one in findings], "unread": unread})
    else:
        print_lines(lines)
    if args.output is not None and findings:
        draw_findings(findings, args.output)
    refused = [one.reason for one in findings if one.mesh is None]
    if unread or refused:
        raise CreaseError(_verdict(len(args.meshes), unread, refused))


def _verdict(count: int, unread: list[str], refused: list[str]) -> str:
    """How many of the files are not right, and the first of them."""
    parts = [f"{len(unread)} of {count} cannot be read"] if unread else []
    parts += [f"{len(refused)} of {count} would be refused"] if refused else []
    return f"{', '.join(parts)}; {[*unread, *refused][0]}"


def rows(one: Findings, voxel_m: float | None) -> list[tuple[str, str]]:
    """The findings for a person."""
    report = one.report()
    name = unit_name(one.unit_m)
    sides = [side / one.unit_m for side in report["size_m"]]
    span = math.hypot(*sides)
    # Of a small side three digits too, whatever the whole.
    size = " x ".join(format_coordinates([s], min(span, 10.0 * s) or span)[0] for s in sides)
    lines = [
        ("mesh", f"{one.source}: {report['triangles']:,} triangles, {size} {name}"),
        ("closed", _closed(report, span)),
        ("crossings", _with_place(f"{report['crossings']:,}", report["crossing_at"], span)),
    ]
    if one.mesh is not None:
        wall = report["thinnest_wall_m"]
        lines += [
            (
                "inside",
                f"{report['volume_m3'] / one.unit_m**3:.4g} {name}^3, {report['shells']:,} shells",
            ),
            ("thinnest wall", _with_place(_wall(wall, voxel_m), report["thinnest_wall_at"], span)),
            (
                "sharpest edge",
                _with_place(_sharpest(one), report["sharpest_edge_at"], span),
            ),
            ("creases", f"{one.creases[0]:,} convex, {one.creases[1]:,} concave"),
        ]
    said = [text.removeprefix(f"{one.source}: ") for text in report["bake"]]
    head = "takes it as it is" if one.mesh is not None else "refuses it"
    return [*lines, *(("bake", text) for text in (said or [head]))]


def _sharpest(one: Findings) -> str:
    if one.sharpest_rad is None:
        return f"none over {one.crease_angle_deg:g} deg"
    return f"{math.degrees(one.sharpest_rad):.0f} deg"


def _closed(report: dict[str, object], span: float) -> str:
    turned = f"{report['turned_edges']:,} edges with two triangles that run the same way"
    turned = _with_place(turned, report["turned_at"], span) if report["turned_edges"] else ""
    if report["closed"]:
        return f"yes, but {turned}" if turned else "yes"
    text = f"no: {report['open_edges']:,} open edges, {report['branched_edges']:,} with three or more triangles"
    return _with_place(text, report["open_at"], span) + (f"; {turned}" if turned else "")


def _wall(wall_m: float | None, voxel_m: float | None) -> str:
    if wall_m is None:
        return "none"
    text = format_length(float(f"{wall_m:.3g}"))
    if voxel_m is not None:
        text += f", {wall_m / voxel_m:.2g} voxels"
        text += "" if wall_m > voxel_m else ": thinner than a voxel, refining has to see it"
    return text


def _with_place(text: str, place: object, size: float) -> str:
    if not isinstance(place, list):
        return text
    return f"{text}, near {format_place(place, size)}"
