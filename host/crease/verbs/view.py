"""`crease view`: replays as one page, a path before it is replayed, the loop while it runs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from crease.base.errors import UsageError
from crease.base.native import RESPONSES
from crease.base.scene import Scene, open_scene
from crease.base.table import check_suffix, check_target, column_names, write_bytes
from crease.replay.recording import is_recording
from crease.replay.replay import DEFAULT_RESPONSE
from crease.verbs.common import (
    STIFFNESS,
    SubParsers,
    add_force,
    add_json,
    add_stiffness,
    number,
    print_either,
    warn,
    whole_in,
)
from crease.verbs.plot import labels

if TYPE_CHECKING:
    from crease.draw.view import Replay


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "view",
        help="a page that shows replays move, a path before, or the loop while it runs",
        description="Make one HTML page that opens from disk: obstacle, moving tool, force arrow, contact areas "
        "and zones, plots with a common cursor. Several replays stand side by side. SCENE.crs PATH.csv shows where a "
        "path will touch before any replay. --live serves the closed loop to a browser on this machine: the mouse is "
        "the hand, or leads the tool off PATH.csv.",
    )
    parser.add_argument(
        "files",
        metavar="FILE",
        type=Path,
        nargs="+",
        help="tables of replay with --scene; or SCENE.crs, then paths or tables",
    )
    parser.add_argument(
        "--scene",
        metavar="SCENE.crs",
        type=Path,
        help="the image that was replayed, with SCENE.crs.glb that bake wrote beside it",
    )
    parser.add_argument("-o", "--output", metavar="REPLAY.html", type=Path, help="the page")
    parser.add_argument("--title", help="heading of the page (default: names of the tables)")
    live = parser.add_argument_group("the loop while it runs")
    live.add_argument("--live", action="store_true", help="serve the loop; ends with Ctrl-C")
    add_stiffness(live)
    live.add_argument(
        "--response",
        choices=list(RESPONSES),
        default=DEFAULT_RESPONSE,
        help="as for `crease replay`",
    )
    live.add_argument(
        "--port",
        metavar="N",
        type=whole_in(0, 65535),
        default=0,
        help="of 127.0.0.1 (default: a free one)",
    )
    live.add_argument(
        "--seconds", metavar="S", type=number(0.1, 1e6), help="end after this long (default: never)"
    )
    live.add_argument("--no-open", action="store_true", help="say the address, open no browser")
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


_LIVE = (
    ("--stiffness", "stiffness", STIFFNESS),
    ("--response", "response", DEFAULT_RESPONSE),
    ("--port", "port", 0),
    ("--seconds", "seconds", None),
    ("--no-open", "no_open", False),
)
"""Options of the loop while it runs, and what they are when they are not given."""


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for files that cannot be read or are of another scene, or a page that cannot be written."""
    for option, name, usual in _LIVE if not args.live else ():
        if getattr(args, name) != usual:
            raise UsageError(f"{option} is of the loop while it runs; give --live too")
    files = list(args.files)
    if args.scene is None and not is_recording(files[0]):
        if files[0].suffix != ".crs":
            raise UsageError(
                f"{files[0]}: of which scene? give --scene SCENE.crs, or SCENE.crs first"
            )
        args.scene = files.pop(0)
    for path in filter(None, (args.scene, *files)):
        if is_recording(path):
            raise UsageError(
                f"{path}: is a recording of the loop, which a page does not show; draw it with `crease plot`, run it "
                "again with `crease replay`, or `crease replay -o RUN.mcap` for other viewers"
            )
    if args.live:
        from crease.verbs import live

        live.run(args, files)
        return
    from crease.draw.view import make_page

    if args.output is None:
        raise UsageError(f"{args.scene}: name the page with -o PAGE.html, or give --live")
    if not files:
        raise UsageError(f"{args.scene}: give a path or a table to show with it, or --live")
    check_suffix(args.output, (".html", ".htm"))
    check_target(args.output, args.force, (args.scene, *files))
    scene = open_scene(args.scene)
    replays = [_replay(scene, name, path) for name, path in zip(labels(files), files, strict=True)]
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


def _replay(scene: Scene, name: str, path: Path) -> Replay:
    """A table as it is; a path, which has no answers yet, with those of the default settings."""
    from crease.draw.view import Replay
    from crease.replay.replay import ANSWER_COLUMNS, REPEAT, run_path, to_columns
    from crease.replay.ticks import read_ticks
    from crease.replay.trajectory import COLUMNS, load_trajectory

    names = set(column_names(path))
    if not names >= set(COLUMNS) or names & set(ANSWER_COLUMNS[1:]):
        return Replay(name, read_ticks(path))
    rows = load_trajectory(path)
    answers = run_path(scene, rows, repeat=REPEAT)
    return Replay(name, to_columns(rows, answers, REPEAT), preview=True)
