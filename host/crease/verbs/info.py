"""`crease info`: what a scene image holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crease.base.errors import SceneError
from crease.base.scene import open_scene
from crease.base.units import format_length
from crease.replay.cost import BOARD_WORK, PERIOD_S, Cost, cost_of, device_names
from crease.replay.trajectory import load_trajectory
from crease.verbs.common import (
    SubParsers,
    add_json,
    add_scene,
    print_json,
    print_lines,
    whole_in,
)


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "info",
        help="tell what a scene image holds",
        description="Check a scene image as the firmware does, and tell what it holds: meshes, creases, distances "
        "and their error, samples of the tool; and with --device what it takes of a controller.",
    )
    add_scene(parser)
    parser.add_argument(
        "--device",
        metavar="NAME",
        help=f"flash, RAM and instructions of a tick on {', '.join(device_names())}",
    )
    parser.add_argument(
        "--work",
        metavar="N",
        type=whole_in(32, 1048576),
        default=BOARD_WORK,
        help=f"with --device: lookups_max, the work of a tick (default: {BOARD_WORK})",
    )
    parser.add_argument(
        "--path",
        metavar="PATH",
        type=Path,
        help="with --device: a path of the tool, CSV or NPZ, whose ticks are counted",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when the file is not a valid image, or the device is not known."""
    if args.path is not None and args.device is None:
        raise SceneError("--path: counts ticks for a controller; name it with --device")
    scene = open_scene(args.scene)
    info = scene.info()
    path = None if args.path is None else load_trajectory(args.path)
    cost = None if args.device is None else cost_of(scene, args.device, args.work, path)
    if args.json:
        print_json(info | ({} if cost is None else {"device": cost.report()}))
    else:
        print_lines(lines(info) + ([] if cost is None else device_lines(cost)))


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


def device_lines(cost: Cost) -> list[tuple[str, str]]:
    """What a scene takes of a controller, for a person."""
    device, along = cost.device, cost.along
    in_flash = device.flash_bytes > 0
    lines = [("device", f"{device.name}: {device.core}, {device.clock_Hz / 1e6:g} MHz")]
    if in_flash:
        lines.append(("flash", _part(cost.flash_bytes, device.flash_bytes, "library and scene")))
    what = "servo, world, stack" if in_flash else "library, scene, servo, world, stack"
    lines.append(("RAM", _part(cost.ram_bytes, device.ram_bytes, what)))
    lines.append(
        (
            "tick",
            f"at most {cost.instructions:,} instructions, by {cost.work} units of work, and one step more",
        )
    )
    if along is not None:
        lines += [
            (
                "along the path",
                f"median {along.p50:,}, p99 {along.p99:,}, largest {along.most:,}, at most, of {along.ticks:,} ticks",
            ),
            ("answers", f"{along.late_mean:.1f} ticks late on average, {along.late_most} at most"),
        ]
    share = 100.0 * cost.largest_s / PERIOD_S
    lines.append(
        ("", f"{1e3 * cost.largest_s:.2f} ms, {share:.0f} % of 1 ms, at one instruction a cycle")
    )
    return lines


def _part(used: int, there: int, what: str) -> str:
    verdict = "fits" if used <= there else "DOES NOT FIT"
    return f"{size_text(used)} ({what}) of {size_text(there)}: {verdict}"
