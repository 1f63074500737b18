"""`crease plot`: tables of ticks as one figure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from crease.base.errors import UsageError
from crease.base.table import check_suffix, check_target, column_names, write_atomic
from crease.replay.recording import cut_warning, is_recording, load_recording
from crease.replay.replay import ANSWER_COLUMNS
from crease.replay.ticks import read_ticks
from crease.verbs.common import SubParsers, add_force, warn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOP_COLUMNS = ("contact_fx_N", "energy_J", "mode", "faults", "states_us")
"""What tells a table of `crease hil` from one of `crease replay`."""

SUFFIXES = (".png", ".svg", ".pdf")


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "plot",
        help="draw tables of ticks, or a run of the loop",
        description="Draw force, torque, depth, change of direction and cost of every tick of replays; or, of one "
        "recording or table of `crease hil`: contact, commanded "
        "and felt force, energy, timing of the bus, state, limits, faults.",
    )
    parser.add_argument(
        "tables",
        metavar="OUT.csv",
        type=Path,
        nargs="+",
        help="tables of replay; or one recording (.crr) or table of hil",
    )
    parser.add_argument(
        "-o", "--output", metavar="FIG.png", type=Path, required=True, help="PNG, SVG or PDF"
    )
    parser.add_argument("--title", help="text above the figure")
    add_force(parser)
    parser.set_defaults(run=run)


def labels(paths: list[Path]) -> list[str]:
    """A short name for each table: the file's stem, or its path where two stems agree."""
    stems = [path.stem for path in paths]
    return [
        stem if stems.count(stem) == 1 else str(path)
        for stem, path in zip(stems, paths, strict=True)
    ]


def _is_loop(path: Path) -> bool:
    """A recording, or a table that `crease hil` wrote."""
    if is_recording(path):
        return True
    return path.is_file() and set(LOOP_COLUMNS) <= set(column_names(path))


def _draw_run(path: Path, title: str | None) -> Figure:
    from crease.draw.plot_loop import draw_loop, recording_table

    if not is_recording(path):
        return draw_loop(read_ticks(path), title or path.stem)
    recording = load_recording(path)
    warn(cut_warning(recording))
    return draw_loop(recording_table(recording), title or path.stem)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for a table that cannot be read, or a figure that cannot be written."""
    check_suffix(args.output, SUFFIXES)
    check_target(args.output, args.force, args.tables)
    if len(args.tables) > 8:
        raise UsageError(
            f"{len(args.tables)} tables in one figure cannot be told apart; give 8 at most"
        )
    from crease.draw.plot import draw_ticks, save_figure

    if len(args.tables) == 1 and _is_loop(args.tables[0]):
        figure = _draw_run(args.tables[0], args.title)
    else:
        if any(is_recording(path) for path in args.tables):
            raise UsageError("a recording is drawn alone; give one file")
        tables = [read_ticks(path, ANSWER_COLUMNS) for path in args.tables]
        figure = draw_ticks(tables, labels(args.tables), args.title)
    kind = args.output.suffix.lower()[1:]
    write_atomic(args.output, lambda file: save_figure(figure, file, kind))
    print(args.output)
