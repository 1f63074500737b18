"""`crease view`: tables of ticks as one page that shows the tool, the force and what is touched."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.base.scene import open_scene
from crease.base.table import check_suffix, check_target, read_table, write_bytes
from crease.verbs.common import SubParsers, add_force, add_json, print_either, warn
from crease.verbs.plot import labels


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "view",
        help="a page that shows replays move",
        description="Make one HTML page that opens from disk: obstacle, moving tool, force arrow, contact areas "
        "and zones, plots with a common cursor. Several replays stand side by side.",
    )
    parser.add_argument("tables", metavar="OUT.csv", type=Path, nargs="+", help="tables of replay")
    parser.add_argument(
        "--scene",
        metavar="SCENE.crs",
        type=Path,
        required=True,
        help="the image that was replayed, with SCENE.crs.glb that bake wrote beside it",
    )
    parser.add_argument(
        "-o", "--output", metavar="REPLAY.html", type=Path, required=True, help="the page"
    )
    parser.add_argument("--title", help="heading of the page (default: names of the tables)")
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for tables that cannot be read or are of another scene, or a page that cannot be written."""
    from crease.draw.view import Replay, make_page

    check_suffix(args.output, (".html", ".htm"))
    check_target(args.output, args.force, (args.scene, *args.tables))
    scene = open_scene(args.scene)
    replays = [
        Replay(name, read_table(path))
        for name, path in zip(labels(args.tables), args.tables, strict=True)
    ]
    page = make_page(replays, scene, args.title or ", ".join(replay.name for replay in replays))
    warn(page.warnings)
    write_bytes(args.output, page.text.encode("utf-8"))
    report = {"output": str(args.output), **page.report, "warnings": list(page.warnings)}
    print_either(
        args.json,
        report,
        [
            ("page", f"{args.output}, {len(page.text.encode('utf-8')) / 1e6:.2f} MB"),
            ("replays", f"{len(replays)}, {report['ticks']:,} ticks"),
        ],
    )
