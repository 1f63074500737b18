"""`crease bench`: run time against error, scaling, and what skipping saves; as CSV, figure and table."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.bench import NAMES, run_bench
from crease.errors import CreaseError
from crease.verbs.common import SubParsers, add_force, whole

QUICK_EVERY, QUICK_REPEAT = 8, 3


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "bench",
        help="run time against error, scaling, ablation",
        description="pareto: time and error over voxel size, sample spacing, tessellation, coverage and response. "
        "scaling: scenes and shells from 1k to 1M. ablation: each level of skipping switched off. "
        "Images that are not baked yet are baked into DIR/images.",
    )
    parser.add_argument(
        "name", choices=[*NAMES, "all"], metavar="NAME", help=", ".join([*NAMES, "all"])
    )
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder")
    parser.add_argument("--quick", action="store_true", help="a part of it, in seconds")
    for option, default, about in (
        ("--meshes", "build/meshes", "meshes and paths as `make meshes` makes them"),
        ("--images", "build/scenes", "images of these meshes that are there already"),
        ("--exact", "tests/golden/exact", "exact tables of the paths"),
    ):
        parser.add_argument(
            option, metavar="DIR", type=Path, default=Path(default), help=f"{about} ({default})"
        )
    parser.add_argument(
        "--peers",
        metavar="FILE",
        type=Path,
        help="points of rival libraries, from `make bench-peers`",
    )
    parser.add_argument(
        "--repeat", metavar="N", type=whole, default=20, help="times are the least of N runs (20)"
    )
    add_force(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when an input is missing, or an output is there and --force is not given."""
    from crease.bench.setup import BenchSetup
    from crease.experiment.report import text_table
    from crease.table import write_bytes

    out: Path = args.output
    if out.exists() and not out.is_dir():
        raise CreaseError(f"{out}: is a file; name a folder")
    names = NAMES if args.name == "all" else (args.name,)
    there = [out / f"{name}.txt" for name in names if (out / f"{name}.txt").exists()]
    if there and not args.force:
        raise CreaseError(f"{there[0]}: exists already; give --force to replace it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CreaseError(f"{out}: cannot be made: {error.strerror}") from error
    every, repeat = (QUICK_EVERY, QUICK_REPEAT) if args.quick else (1, args.repeat)
    setup = BenchSetup(
        args.meshes, args.images, out, every, repeat,
        exact=args.exact, peers=args.peers, quick=args.quick,
    )  # fmt: skip
    for name in names:
        result = run_bench(name, setup)
        text = "\n\n".join([*(text_table(t) for t in result.tables), *result.found])
        text = f"{result.title}\n\n{result.about}\n\n{text}\n"
        print(text, flush=True)
        write_bytes(out / f"{name}.txt", text.encode())
