"""`crease info`: what a scene image holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crease.base.errors import UsageError
from crease.base.scene import open_scene
from crease.base.units import format_length
from crease.replay.cost import (
    BOARD_LATE_MAX,
    BOARD_WORK,
    PERIOD_S,
    Beside,
    Cost,
    Ticks,
    cost_of,
    device_names,
)
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
        type=str.lower,
        choices=device_names(),
        help=f"room for the scene, memory, and instructions of a tick on {', '.join(device_names())}",
    )
    parser.add_argument(
        "--work",
        metavar="N",
        type=whole_in(32, 1048576),
        help=f"with --device: lookups_max, the work of a tick that searches itself (default: {BOARD_WORK})",
    )
    parser.add_argument(
        "--path",
        metavar="PATH",
        type=Path,
        help="with --device: a path of the tool, CSV or NPZ: most instructions of its ticks, and how late answers come",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when the file is not a valid image."""
    for option, value in (("--path", args.path), ("--work", args.work)):
        if value is not None and args.device is None:
            raise UsageError(f"{option}: counts ticks for a controller; name it with --device")
    scene = open_scene(args.scene)
    info = scene.info()
    path = None if args.path is None else load_trajectory(args.path)
    work = args.work or BOARD_WORK
    cost = None if args.device is None else cost_of(scene, args.device, work, path)
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
    device, within, beside = cost.device, cost.within, cost.beside
    stack = f"stack {size_text(device.stack_bytes)}, with the search beside {size_text(device.beside_stack_bytes)}"
    what = f"servo and world; library {size_text(device.code_bytes)}, {stack}"
    lines = [
        (
            "device",
            f"{device.name}: {device.core}, {device.clock_Hz / 1e6:g} MHz; times at one instruction a cycle",
        ),
        ("room", _part(cost.scene_bytes, device.scene_bytes, "scene")),
        ("memory", _part(cost.memory_bytes, device.memory_bytes, what)),
    ]
    if within is None or beside is None:
        return [
            *lines,
            (
                "tick",
                f"searching itself: {cost.instructions:,} instructions for {cost.work} units of work,",
            ),
            ("", f"and one step more: {cost.step:,} at the deepest pose found, no bound"),
            ("", _share(cost.largest_s)),
            ("", "--path tells what a path takes, with the search in the tick and beside it"),
        ]
    return [
        *lines,
        (
            "tick",
            f"searching itself, {cost.work} units of work and a step: median {within.p50:,}, p99 {within.p99:,},",
        ),
        ("", f"most on this path {within.most:,} instructions, of {within.ticks:,} ticks"),
        ("", f"{_share(within.largest_s)}; {_late(within)}"),
        (
            "search beside",
            f"tick that only feels and interrupts it, {beside.feel:,} instructions",
        ),
        ("", f"{_share(beside.largest_s)}; {_late(beside)}"),
    ]


def _share(time_s: float) -> str:
    verdict = "keeps 1 kHz" if time_s <= PERIOD_S else "TOO LONG FOR 1 kHz"
    return f"{1e3 * time_s:.2f} ms, {100.0 * time_s / PERIOD_S:.0f} % of 1 ms: {verdict}"


def _late(along: Ticks | Beside) -> str:
    text = f"answers {along.late_mean:.1f} ticks late on average, {along.late_most} at most"
    late = along.late_most > BOARD_LATE_MAX
    return text + (f": TOO LATE, the boards fault beyond {BOARD_LATE_MAX}" if late else "")


def _part(used: int, there: int, what: str) -> str:
    verdict = "fits" if used <= there else "DOES NOT FIT"
    return f"{used / 2**10:,.1f} KiB of {there / 2**10:,.0f} KiB ({what}): {verdict}"
