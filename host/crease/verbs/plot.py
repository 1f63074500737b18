"""`crease plot`: tables of ticks as one figure."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.errors import CreaseError
from crease.replay import ANSWER_COLUMNS
from crease.table import check_suffix, check_target, read_table, write_atomic
from crease.verbs.common import SubParsers, add_force

SUFFIXES = (".png", ".svg", ".pdf")


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "plot",
        help="draw tables of ticks",
        description="Draw force, depth, change of direction and cost of every tick.",
    )
    parser.add_argument("tables", metavar="OUT.csv", type=Path, nargs="+", help="tables of replay")
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


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError for a table that cannot be read, or a figure that cannot be written."""
    check_suffix(args.output, SUFFIXES)
    check_target(args.output, args.force)
    if len(args.tables) > 8:
        raise CreaseError(
            f"{len(args.tables)} tables in one figure cannot be told apart; give 8 at most"
        )
    tables = [read_table(path, ANSWER_COLUMNS) for path in args.tables]

    from crease.plot import draw_ticks, save_figure

    figure = draw_ticks(tables, labels(args.tables), args.title)
    kind = args.output.suffix.lower()[1:]
    write_atomic(args.output, lambda file: save_figure(figure, file, kind))
    print(args.output)
