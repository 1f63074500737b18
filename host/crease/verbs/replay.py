"""`crease replay`: a path through a scene, tick by tick, into a table."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from crease.base.errors import UsageError
from crease.base.native import COVERAGES, RESPONSES, SKIPS, lib, skip_mask
from crease.base.progress import Progress
from crease.base.scene import Scene, open_scene
from crease.base.table import check_suffix, check_target, write_table
from crease.base.units import format_length
from crease.replay.recording import is_recording
from crease.replay.replay import (
    DEFAULT_RESPONSE,
    REPEAT,
    CoupleOptions,
    ReplayOptions,
    run_path,
    to_columns,
)
from crease.replay.trajectory import Trajectory, load_trajectory
from crease.verbs.common import (
    STIFFNESS,
    SubParsers,
    add_couple,
    add_force,
    add_json,
    add_scene,
    add_stiffness,
    couple_options,
    far_centre,
    number,
    print_either,
    warn,
    whole,
    whole_in,
)


def skips(text: str) -> int:
    """Type of an option that is a list of skips."""
    names = [] if text == "none" else text.split(",")
    for name in names:
        if name not in SKIPS:
            known = ", ".join(SKIPS)
            if name == "none":
                raise argparse.ArgumentTypeError("'none' stands alone; leave it or the others out")
            raise argparse.ArgumentTypeError(f"'{name}' is no skip; known are none, {known}")
    return skip_mask(names)


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "replay",
        help="run a path of the tool through a scene",
        description="Run the firmware's tick along a path and keep what every tick answered. A recording (.crr) "
        "runs again with the settings it was made with, and is compared to the bit.",
    )
    add_scene(parser)
    parser.add_argument(
        "path",
        metavar="PATH",
        type=Path,
        help="CSV with t_s,x_m,y_m,z_m,qw,qx,qy,qz (world_from_tool), or NPZ; or a recording of the servo (.crr)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.csv",
        type=Path,
        required=True,
        help="the table, CSV or NPZ by suffix; or MCAP: ROS 2 messages with contact points and areas",
    )
    add_stiffness(parser, couple=True)
    parser.add_argument(
        "--damping",
        metavar="Ns/m",
        type=number(0.0, 1e4),
        default=0.0,
        help="along the normal, 0 to 1e4 (default: 0)",
    )
    parser.add_argument(
        "--response",
        metavar="NAME",
        choices=list(RESPONSES),
        default=DEFAULT_RESPONSE,
        help=f"how contact becomes force: {', '.join(RESPONSES)} (default: {DEFAULT_RESPONSE})",
    )
    parser.add_argument(
        "--coverage",
        choices=list(COVERAGES),
        default="soft",
        help="soft: a sample counts by the part of it that is inside; hard: in or out, as published, with extent and "
        "the other responses that way_out is compared with (default: soft)",
    )
    parser.add_argument(
        "--lookups",
        metavar="N",
        type=whole_in(32, 1 << 20),
        help="work of one tick in lookups of 16 points; an answer that needs more takes several ticks (default: "
        f"{lib.cr_config_default().lookups_max})",
    )
    parser.add_argument(
        "--force-max",
        metavar="N",
        type=number(1e-6, 1e6),
        help="limit of the force, 1e-6 to 1e6 (default: the firmware's, 100)",
    )
    parser.add_argument(
        "--skips",
        metavar="LIST",
        type=skips,
        help="what detection may skip, comma-separated: top, tree, coherence, or none; the answer is the same to "
        "the bit (default: all)",
    )
    parser.add_argument(
        "--repeat",
        metavar="N",
        type=whole,
        default=REPEAT,
        help=f"run the path N times and keep each tick's least time: its cost, not the scheduler's (default: {REPEAT})",
    )
    add_couple(
        parser,
        "hold the tool outside the mock-up, tied to the hand by a spring in six degrees of freedom, which is what "
        "is felt: --stiffness and --damping are the spring's, and its force has no limit",
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


_UNCOUPLED = (
    ("--lookups", "lookups"),
    ("--force-max", "force_max"),
    ("--skips", "skips"),
)
"""Options that say nothing of a held tool."""


_OF_PATHS = (
    ("--stiffness", "stiffness", STIFFNESS),
    ("--damping", "damping", 0.0),
    ("--response", "response", DEFAULT_RESPONSE),
    ("--coverage", "coverage", "soft"),
    ("--lookups", "lookups", None),
    ("--force-max", "force_max", None),
    ("--skips", "skips", None),
    ("--repeat", "repeat", REPEAT),
)
"""Options that say nothing of a recording, and what they are when they are not given."""


def _check_recording(args: argparse.Namespace) -> None:
    """Errors: UsageError for an option that a recording has itself."""
    for option, name, usual in _OF_PATHS:
        if getattr(args, name) != usual:
            raise UsageError(
                f"{option}: {args.path} is a recording, which runs again with its own settings; leave it out, or "
                "give a path"
            )


def _couple_of(args: argparse.Namespace) -> CoupleOptions | None:
    """Settings of the held tool; None without --couple.   Errors: UsageError for options that do not go together."""
    couple = couple_options(args)
    if couple is None:
        if (
            args.coverage != "soft"
            and args.response == DEFAULT_RESPONSE
            and not is_recording(args.path)
        ):
            raise UsageError(
                f"--coverage {args.coverage}: {DEFAULT_RESPONSE} weighs every sample by its depth; give --response "
                "extent too, the method as published"
            )
        return None
    for option, name in _UNCOUPLED:
        if getattr(args, name) is not None:
            raise UsageError(f"--couple has no {option}; leave it out")
    if args.coverage != "soft":
        raise UsageError("--couple has no --coverage; leave it out")
    if args.response != DEFAULT_RESPONSE:
        raise UsageError(f"--response {args.response}: a held tool has no response but its own")
    if args.output.suffix == ".mcap" or is_recording(args.path):
        raise UsageError("--couple runs a path, CSV or NPZ, into a table, CSV or NPZ")
    return couple


_FAR = 10.0
"""Diagonals of the mock-up from its middle: nobody moves a tool so far off on purpose."""


def _far_away(scene: Scene, path: Trajectory) -> list[str]:
    """A warning when a path without contact leaves the mock-up far behind: most likely it is in mm."""
    meta = scene.meta
    low_m, high_m = (np.array(list(box)) for box in (meta.static_min_m, meta.static_max_m))
    away_m = float(np.linalg.norm(path.position_m - 0.5 * (low_m + high_m), axis=1).max())
    size_m = float(np.linalg.norm(high_m - low_m))
    if away_m <= _FAR * size_m:
        return []
    return [
        f"no contact; the path goes {format_length(away_m)} away from a mock-up of {format_length(size_m)}: "
        "are its positions in metres?"
    ]


def _point_only(
    response: str, contacts: npt.NDArray[np.uint32], force_N: npt.NDArray[np.floating]
) -> list[str]:
    """A warning where god_object is silent in contact: it feels with a point, not with the tool."""
    touching = contacts > 0
    silent = int(np.count_nonzero(touching & (force_N == 0.0)))
    if response != "god_object" or silent == 0:
        return []
    return [
        f"--response {response}: no force in {silent} of {np.count_nonzero(touching)} ticks in which the tool touches; "
        "it feels with one point, the tool's origin, and not with its shape"
    ]


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for a bad scene, a bad row, or an output that cannot be written."""
    couple = _couple_of(args)
    if is_recording(args.path):
        _check_recording(args)
    check_suffix(args.output, (".csv", ".npz", ".mcap"))
    check_target(args.output, args.force, (args.scene, args.path))
    if is_recording(args.path):
        from crease.verbs import rerun

        rerun.run(args)
        return
    start_s = time.monotonic()
    scene = open_scene(args.scene)
    path = load_trajectory(args.path)
    options = ReplayOptions(
        stiffness_N_m=args.stiffness,
        damping_Ns_m=args.damping,
        response=args.response,
        coverage=args.coverage,
        lookups_max=args.lookups,
        force_max_N=args.force_max,
        skip=args.skips,
        couple=couple,
    )
    with Progress() as progress:
        rows = run_path(
            scene, path, options, args.repeat, progress=lambda part: progress("replay", part)
        )
    if args.output.suffix == ".mcap":
        from crease.replay.export import write_replay

        write_replay(args.output, scene, path, rows, options)
    else:
        write_table(args.output, to_columns(path, rows, args.repeat, options))
    force_N = np.linalg.norm(rows["force_N"], axis=1)
    overflow = int(np.count_nonzero(rows["overflow"]))
    limit_N = args.force_max or float(lib.cr_config_default().force_max_N)
    # The firmware scales the force to the limit: what reaches it was cut. Everything else counted is contact left out.
    cut = (rows["overflow"] > 0) & (force_N > limit_N * (1.0 - 1e-5)) & (couple is None)
    left_out = int(np.count_nonzero(rows["overflow"] > cut))
    warnings = far_centre(scene, couple)
    if cut.any():
        warnings.append(
            f"{np.count_nonzero(cut)} of {len(path)} ticks reached the limit of the force, {limit_N:g} N"
        )
    if left_out:
        what = "clusters, surfaces, areas or zones" if couple is None else "samples or contacts"
        warnings.append(
            f"{left_out} of {len(path)} ticks left out contact: more {what} than have room"
        )
    late = int(np.count_nonzero(rows["late_ticks"]))
    if late and couple is not None:
        warnings.append(f"{late} of {len(path)} ticks ended before the held tool had caught up")
    elif late:
        oldest = int(rows["late_ticks"].max())
        warnings.append(
            f"{late} of {len(path)} ticks answer an earlier pose, up to {oldest} ticks old"
        )
    warnings += _point_only(args.response, rows["contacts"], force_N)
    if not rows["contacts"].any():
        warnings += _far_away(scene, path)
    warn(warnings)
    report: dict[str, object] = {
        "output": str(args.output),
        "ticks": len(path),
        "ticks_in_contact": int(np.count_nonzero(rows["areas"])),
        "ticks_limited": overflow,
        "ticks_force_limited": int(np.count_nonzero(cut)),
        "ticks_left_out": left_out,
        "ticks_late": late,
        "force_max_N": float(force_N.max()),
        "depth_max_m": float(rows["depth_m"].max()),
        "tick_p50_ns": float(np.percentile(rows["tick_ns"], 50)),
        "tick_p99_ns": float(np.percentile(rows["tick_ns"], 99)),
        "time_s": round(time.monotonic() - start_s, 3),
        "warnings": warnings,
    }
    print_either(
        args.json,
        report,
        [
            ("table", str(args.output)),
            ("ticks", f"{len(path):,}, {report['ticks_in_contact']:,} in contact"),
            ("force", f"{report['force_max_N']:.4g} N max"),
            (
                "depth" if couple is None else "hand",
                f"{1e3 * float(rows['depth_m'].max()):.4g} mm "
                + ("max" if couple is None else "from the held tool at most"),
            ),
            (
                "tick",
                f"{float(np.percentile(rows['tick_ns'], 50)) / 1e3:.2f} us median, "
                f"{float(np.percentile(rows['tick_ns'], 99)) / 1e3:.2f} us p99",
            ),
            ("time", f"{report['time_s']:.2f} s"),
        ],
    )
