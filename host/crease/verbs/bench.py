"""`crease bench`: run time against error, scaling, what skipping saves, bytes read; as CSV, figure and table."""

from __future__ import annotations

import argparse
from pathlib import Path

from crease.base.errors import CreaseError, UsageError
from crease.base.tree import from_tree
from crease.verbs.common import (
    SubParsers,
    add_force,
    add_inputs,
    check_folder,
    check_inputs,
    made_folder,
    whole,
)

NAMES = ("properties", "pareto", "precision", "scaling", "ablation", "touched")
QUICK_EVERY, QUICK_REPEAT = 8, 3
REPEAT = 20
TABLE = Path("meshes/property_scenes.toml")
OF = {
    "table": ("properties",),
    "scenes": ("properties", "touched"),
    "responses": ("properties",),
    "search": ("properties",),
    "peers": ("properties", "pareto"),
    "repeat": tuple(name for name in NAMES if name != "touched"),
}
"""Options that not every study heeds."""


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "bench",
        help="properties of the force, run time against error, precision, scaling, ablation, bytes read",
        description="properties: nine properties that a contact force must have, on scenes of their own. "
        "pareto: time and error over voxel size, sample spacing, tessellation, coverage and response. "
        "precision: float32 against double. "
        "scaling: scenes and shells from 1k to 1M. ablation: each level of skipping switched off. "
        "touched: bytes of the image that a tick reads, counted (gcc). "
        "Images that are not baked yet are baked into DIR/images.",
    )
    parser.add_argument(
        "name", choices=[*NAMES, "all"], metavar="NAME", help=", ".join([*NAMES, "all"])
    )
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder")
    parser.add_argument(
        "--quick", action="store_true", help="a part of it, in seconds to two minutes"
    )
    add_inputs(parser)
    parser.add_argument(
        "--exact",
        metavar="DIR",
        type=Path,
        default=Path("tests/golden/exact"),
        help="exact tables of the paths (tests/golden/exact)",
    )
    parser.add_argument(
        "--peers",
        metavar="FILE",
        type=Path,
        help="of rival libraries: points, from `make bench-peers`; properties: folder of answers",
    )
    parser.add_argument(
        "--repeat",
        metavar="N",
        type=whole,
        help=f"times are the least of N runs ({REPEAT}); not with --quick, which has {QUICK_REPEAT}",
    )
    parser.add_argument(
        "--table",
        metavar="FILE",
        type=Path,
        help=f"properties: table of scenes ({TABLE})",
    )
    parser.add_argument(
        "--scenes",
        metavar="NAME,...",
        type=words,
        default=(),
        help="properties, touched: only these scenes",
    )
    parser.add_argument(
        "--responses",
        metavar="NAME,...",
        type=words,
        default=(),
        help="properties: only these responses",
    )
    parser.add_argument(
        "--search", action="store_true", help="properties: the worst poses near the paths instead"
    )
    add_force(parser)
    parser.set_defaults(run=run)


def words(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    return tuple(name for name in text.split(",") if name)


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError when an input is missing, or an output is there and --force is not given."""
    from crease.base.table import write_bytes
    from crease.lab.report import text_table

    for option, studies in OF.items():
        if getattr(args, option) and args.name not in (*studies, "all"):
            listed = " and ".join(filter(None, [", ".join(studies[:-1]), studies[-1]]))
            raise UsageError(f"--{option} is of {listed}; leave it out of {args.name}")
    if args.quick and args.repeat:
        raise UsageError(
            f"--quick: times are the least of {QUICK_REPEAT} runs; leave out --repeat, or --quick"
        )
    study = from_tree("bench", "study.run")
    out: Path = args.output
    check_folder(out)
    names = NAMES if args.name == "all" else (args.name,)
    there = [out / f"{name}.txt" for name in names if (out / f"{name}.txt").exists()]
    if there and not args.force:
        raise CreaseError(f"{there[0]}: exists already; give --force to replace it")
    # The meshes of scaling are made on the way, the images of properties too.
    if names not in (("scaling",), ("properties",)):
        check_inputs(args)
    every, repeat = (QUICK_EVERY, QUICK_REPEAT) if args.quick else (1, args.repeat or REPEAT)
    setup = study.BenchSetup(
        args.meshes, args.images, out, every, repeat,
        exact=args.exact, peers=args.peers, quick=args.quick,
        property_scenes=args.table or TABLE, scenes=args.scenes, responses=args.responses, search=args.search,
    )  # fmt: skip
    with made_folder(out):
        for name in names:
            result = study.run_bench(name, setup)
            text = "\n\n".join([*(text_table(t) for t in result.tables), *result.found])
            text = f"{result.title}\n\n{result.about}\n\n{text}\n"
            print(text, flush=True)
            write_bytes(out / f"{name}.txt", text.encode())
