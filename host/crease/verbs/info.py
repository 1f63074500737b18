"""`crease info`: what a scene image holds."""

from __future__ import annotations

import argparse
from typing import Any

from crease.base.scene import open_scene
from crease.base.units import format_length
from crease.verbs.common import SubParsers, add_json, add_scene, print_json, print_lines


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "info",
        help="tell what a scene image holds",
        description="Check a scene image as the firmware does, and tell what it holds: meshes, creases, distances "
        "and their error, samples of the tool.",
    )
    add_scene(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when the file is not a valid image."""
    info = open_scene(args.scene).info()
    if args.json:
        print_json(info)
    else:
        print_lines(lines(info))


def size_text(size: object) -> str:
    """Bytes for a person."""
    assert isinstance(size, int)
    return f"{size / 2**20:.2f} MiB" if size >= 2**20 else f"{size / 2**10:.1f} KiB"


def _box(part: dict[str, Any]) -> str:
    sides = [
        format_length(high - low) for low, high in zip(part["min_m"], part["max_m"], strict=True)
    ]
    return " x ".join(sides)


def lines(info: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and values of a scene, for a person."""
    static, voxmap, tool = info["static"], info["voxmap"], info["tool"]
    return [
        (
            "scene",
            f"{info['file']}, {size_text(info['image_bytes'])}, format {info['image_version']}",
        ),
        ("checksum", f"crc32 {info['image_crc32']}"),
        ("static", f"{static['triangles']:,} triangles, {_box(static)}"),
        ("", f"sha256 {static['sha256']}"),
        ("surface", f"{static['patches']:,} smooth patches, {static['facets']:,} facets"),
        (
            "creases",
            f"{static['convex_edges']:,} convex, {static['concave_edges']:,} concave edges "
            f"over {static['crease_angle_deg']:.3g} deg; {static['smooth_edges']:,} smooth",
        ),
        (
            "voxmap",
            f"voxel {format_length(voxmap['voxel_m'])}, {voxmap['bricks']:,} near bricks in "
            f"{' x '.join(str(n) for n in voxmap['dims'])}, {voxmap['samples']:,} distances",
        ),
        (
            "distance error",
            f"{format_length(voxmap['error_max_m'])} max, {format_length(voxmap['error_rms_m'])} RMS, "
            f"stored up to {format_length(voxmap['band_m'])}",
        ),
        ("tool", f"{tool['triangles']:,} triangles, {_box(tool)}"),
        ("", f"sha256 {tool['sha256']}"),
        (
            "point shell",
            f"{tool['points']:,} samples {format_length(tool['spacing_m'])} apart in "
            f"{tool['clusters']:,} clusters, {tool['levels']} levels of spheres",
        ),
    ]
