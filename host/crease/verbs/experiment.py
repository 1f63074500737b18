"""`crease experiment`: the paper's experiments and where the method breaks, as CSV, figures, tables and one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.base.errors import CreaseError
from crease.lab.run import NAMES, run_experiment
from crease.lab.setup import Setup
from crease.verbs.common import (
    SubParsers,
    add_force,
    add_inputs,
    check_folder,
    check_inputs,
    make_folder,
    whole,
)

REPORT = "report.html"


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "experiment",
        help="the paper's experiments, as CSV, figures and tables",
        description="Run an experiment of the paper, or all of them with one page to read (report.html). "
        "Images that are not baked yet are baked into DIR/images.",
    )
    parser.add_argument(
        "name", choices=[*NAMES, "all"], metavar="NAME", help=", ".join([*NAMES, "all"])
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="folder for the files"
    )
    add_inputs(parser)
    parser.add_argument(
        "--every", metavar="N", type=whole, default=1, help="only each N-th pose, for a quick look"
    )
    parser.add_argument(
        "--repeat",
        metavar="N",
        type=whole,
        default=20,
        help="timings are the least of N runs (20)",
    )
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when a mesh is missing, or the folder holds something and --force is not given."""
    from crease.base.table import write_bytes
    from crease.lab.report import make_report, text_table

    out: Path = args.output
    names = NAMES if args.name == "all" else (args.name,)
    check_folder(out)
    if out.exists() and any(p.name != "images" for p in out.iterdir()) and not args.force:
        raise CreaseError(
            f"{out}: holds files already; give --force to replace them, or name another folder"
        )
    check_inputs(args)
    make_folder(out)
    setup = Setup(args.meshes, args.images, out, args.every, args.repeat)
    results = []
    for name in names:
        result = run_experiment(name, setup)
        results.append(result)
        text = "\n\n".join([*(text_table(t) for t in result.tables), *result.found])
        print(f"{result.title}\n\n{text}\n", flush=True)
        write_bytes(out / f"{name}.txt", (text + "\n").encode())
    if args.name == "all":
        write_bytes(out / REPORT, make_report(results, out, args.every, args.repeat).encode())
        print(f"page: {out / REPORT}")
