"""`crease experiment`: the paper's experiments and where the method breaks, as CSV, figures, tables and one page."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from crease.base.errors import CreaseError
from crease.lab.run import NAMES, missing_inputs, run_experiment
from crease.lab.setup import Result, Setup
from crease.verbs.common import (
    SubParsers,
    add_force,
    add_inputs,
    check_folder,
    check_inputs,
    made_folder,
    warn,
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
    """Errors: CreaseError when a mesh is missing, the folder holds something and --force is not given, or one of
    all the experiments fails: the others run, and the page says what is missing.
    """
    out: Path = args.output
    names = NAMES if args.name == "all" else (args.name,)
    check_folder(out)
    if out.exists() and any(p.name != "images" for p in out.iterdir()) and not args.force:
        raise CreaseError(
            f"{out}: holds files already; give --force to replace them, or name another folder"
        )
    check_inputs(args)
    check_files(names, args.meshes)
    with made_folder(out):
        _run_all(args, names)


def _run_all(args: argparse.Namespace, names: Sequence[str]) -> None:
    from crease.base.table import write_bytes
    from crease.lab.report import make_report, text_table

    out: Path = args.output
    setup = Setup(args.meshes, args.images, out, args.every, args.repeat)
    results: list[Result] = []
    missing = dict.fromkeys(names, "has not run")
    for name in names:
        try:
            result = run_experiment(name, setup)
        except CreaseError as error:
            if len(names) == 1:
                raise
            missing[name] = f"failed: {error}"
            warn([f"{name} {missing[name]}"])
        else:
            del missing[name]
            results.append(result)
            text = "\n\n".join([*(text_table(t) for t in result.tables), *result.found])
            print(f"{result.title}\n\n{text}\n", flush=True)
            write_bytes(out / f"{name}.txt", (text + "\n").encode())
        if len(names) > 1:  # as far as it goes: what ends the rest leaves that
            page = make_report(results, out, args.every, args.repeat, missing)
            write_bytes(out / REPORT, page.encode())
    if len(names) > 1:
        print(f"page: {out / REPORT}")
    if missing:
        raise CreaseError(f"{out / REPORT}: is without {', '.join(missing)}, which failed")


def check_files(names: Sequence[str], meshes: Path) -> None:
    """Errors: CreaseError when a file that these experiments read is missing: said before any of them runs."""
    if missing := missing_inputs(names, meshes):
        more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise CreaseError(
            f"{missing[0]}: is missing{more}; run `make meshes`, or name the folder with --meshes"
        )
