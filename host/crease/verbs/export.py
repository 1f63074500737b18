"""`crease export`: tables and recordings as files that others open."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.base.errors import UsageError
from crease.base.scene import open_scene
from crease.base.table import check_suffix, check_target
from crease.verbs.common import SubParsers, add_force, add_json, print_either, warn

FORMATS = ("mcap", "csv", "npz", "parquet")
"""As crease.replay.export has them, which is imported when it is used."""


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "export",
        help="a run of the loop or a table as MCAP, Parquet, CSV or NPZ",
        description="Write a recording of `crease hil` or creased, or a table of `crease replay`, in another format. "
        "MCAP holds ROS 2 messages (pose, tf, wrench, contact; of a recording joints and servo), as Foxglove and ROS "
        "read them; it needs `pip install mcap`, Parquet `pip install pyarrow`.",
    )
    parser.add_argument(
        "input", metavar="FILE", type=Path, help="a recording (.crr) or a table (.csv, .npz)"
    )
    parser.add_argument(
        "--to",
        metavar="FORMAT",
        choices=FORMATS,
        help=f"{', '.join(FORMATS)} (default: the suffix of OUT)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        type=Path,
        help="(default: FILE with the suffix of the format)",
    )
    parser.add_argument(
        "--scene",
        metavar="SCENE.crs",
        type=Path,
        help="of a recording to MCAP: contact points and areas too",
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for another kind of file, a missing package, an output that cannot be written."""
    from crease.replay.export import export

    if args.to is None and args.output is None:
        raise UsageError("export to what? give -o OUT with its suffix, or --to")
    out = args.output or args.input.with_suffix(f".{args.to}")
    formats = FORMATS if args.to is None else (args.to,)
    check_suffix(out, tuple(f".{name}" for name in formats))
    kind = out.suffix.lower().removeprefix(".")
    check_target(out, args.force, (args.input,))
    scene = None if args.scene is None else open_scene(args.scene)
    ticks, warnings = export(args.input, kind, out, scene)
    warn(warnings)
    report: dict[str, object] = {
        "output": str(out),
        "ticks": ticks,
        "bytes": out.stat().st_size,
        "warnings": warnings,
    }
    print_either(args.json, report, [("output", str(out)), ("ticks", f"{ticks:,}")])
