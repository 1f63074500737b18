"""`crease stress`: random scenes, poses and settings by the ten thousand, and the truths that must hold in all."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from crease.base.tree import from_tree
from crease.verbs.common import SubParsers, add_json, number, print_json, print_lines, whole

SUMMARY = "summary.json"
PER_CHUNK = 1000
DRIFT_TICKS = 10_000_000
OF_CASES = ("cases", "seed", "per_chunk", "scenes", "shrink", "scheduler", "tls", "drift")
"""Options that --closed-loop does not heed."""
SHOWN = 8
"""Violations that are listed on the screen; all are in summary.json."""


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "stress",
        help="random scenes and poses against the tick: what must always hold",
        description="Run a seeded campaign of random cases. It can be stopped and started again with the same command: "
        "chunks that are done stay. Violations are kept in DIR/violations, each with the command that replays it. "
        "Exit status 1 when there are any.",
    )
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder")
    parser.add_argument("--cases", metavar="N", type=whole, default=100_000, help="(100000)")
    parser.add_argument("--seed", metavar="N", type=whole, default=1, help="of all cases (1)")
    parser.add_argument(
        "--jobs", metavar="N", type=whole, default=1, help="processes on this machine (1)"
    )
    parser.add_argument(
        "--per-chunk", metavar="N", type=whole, default=PER_CHUNK,
        help=f"cases that share scenes and a file ({PER_CHUNK})",
    )  # fmt: skip
    parser.add_argument(
        "--scenes", metavar="N", type=whole, default=4, help="scenes of a chunk (4)"
    )
    parser.add_argument(
        "--shrink", metavar="SECONDS", type=number(0.0, 3600.0), default=2.0,
        help="processor time to simplify the solids of each reproducer (2)",
    )  # fmt: skip
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="an existing Dask cluster that sees DIR, instead of --jobs: "
        "tls://..., or tcp://... where nobody else reaches its ports, since workers run what they are sent",
    )  # fmt: skip
    parser.add_argument(
        "--tls",
        metavar="DIR",
        type=Path,
        help="of a scheduler at tls://: ca.pem, cert.pem, key.pem",
    )
    parser.add_argument(
        "--drift", metavar="TICKS", type=whole, default=DRIFT_TICKS,
        help="length of the two runs on quaternion drift (ten million)",
    )  # fmt: skip
    parser.add_argument(
        "--closed-loop", action="store_true",
        help="instead: the largest stiffness that settles, over damping, delay and hand, for several responses on a "
        "wall, an edge, a corner and in a groove; CSV and figure (an hour of processor time)",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true", help="with --closed-loop: two responses, one loop"
    )
    add_json(parser)
    parser.set_defaults(run=run, usual={name: parser.get_default(name) for name in OF_CASES})


def run(args: argparse.Namespace) -> None:
    """Errors: CreaseError, also when a truth does not hold."""
    import json
    from dataclasses import asdict

    from crease.base.errors import CreaseError, UsageError
    from crease.base.progress import Progress
    from crease.base.table import write_bytes

    if args.quick and not args.closed_loop:
        raise UsageError("--quick is of --closed-loop; give that too, or fewer --cases")
    for name in OF_CASES if args.closed_loop else ():
        if getattr(args, name) != args.usual[name]:
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} is of random cases; leave it out with --closed-loop")
    if args.tls and not args.scheduler:
        raise UsageError("--tls is of a scheduler; give --scheduler too")
    if args.closed_loop:
        _closed_loop(args)
        return
    campaign, drift = from_tree("stress", "stress.campaign"), from_tree("stress", "stress.drift")
    start_s = time.monotonic()
    settings = campaign.Settings(args.seed, args.cases, args.per_chunk, args.scenes, args.shrink)
    with Progress() as progress:
        reports = campaign.run_campaign(
            args.output,
            settings,
            args.jobs,
            args.scheduler,
            lambda part: progress("stress", part),
            args.tls,
        )
    violations = [v for report in reports for v in report["violations"]]
    drifts = [drift.run_drift(args.seed, args.drift, unit) for unit in (True, False)]
    failed = sum(bool(d.failed) for d in drifts)
    summary = campaign.summarise(reports)
    summary |= {"seed": args.seed, "drift": [asdict(d) for d in drifts]}
    summary["listed"] = violations
    summary["seconds"] = round(time.monotonic() - start_s, 1)
    write_bytes(args.output / SUMMARY, (json.dumps(summary, indent=1) + "\n").encode())
    if args.json:
        print_json(summary)
    else:
        _tell(summary, args.output)
    if violations or failed:
        raise CreaseError(
            f"{len(violations)} of {summary['cases']:,} cases and {failed} of {len(drifts)} drift runs found a "
            f"violation; see {args.output / SUMMARY}"
        )


def _closed_loop(args: argparse.Namespace) -> None:
    from dataclasses import asdict

    from crease.base.progress import Progress

    closed_loop = from_tree("stress", "stress.closed_loop")
    args.output.mkdir(parents=True, exist_ok=True)
    with Progress() as progress:
        cells = closed_loop.run_map(
            args.output, args.jobs, args.quick, lambda part: progress("loop", part)
        )
    if args.json:
        print_json({"cells": [asdict(cell) for cell in cells]})
        return
    print_lines(
        [
            (
                f"{c.response}, {c.place}",
                f"{c.hand} hand, {c.delay_ms:g} ms, {c.damping_Ns_m:g} N s/m: {c.largest_N_m:.0f} N/m, "
                f"{c.largest_N_m / c.bound_N_m:.2f} of the bound",
            )
            for c in cells
        ]
    )
    print(f"{args.output / 'closed_loop.png'}")


def _tell(summary: dict[str, Any], folder: Path) -> None:
    rate = summary["cases"] / max(summary["cpu_s"], 1e-9)
    baking = summary["bake_cpu_s"] / max(summary["cpu_s"], 1e-9)
    lines = [
        ("cases", f"{summary['cases']:,} in {summary['scenes']:,} scenes, {summary['ticks']:,} ticks"),
        ("cost", f"{rate:.0f} cases per second of processor time, {baking:.0%} of it baking"),
    ]  # fmt: skip
    for name, kind in summary["kinds"].items():
        lines.append((name, f"{kind['cases']:,} cases, {kind['ticks']:,} ticks"))
    for name, n in summary["numbers"].items():
        lines.append(
            (
                name,
                f"p50 {n['p50']:.3g}, p99 {n['p99']:.3g}, p99.9 {n['p99.9']:.3g}, max {n['max']:.3g}",
            )
        )
    for drift in summary["drift"]:
        how = "made a unit each tick" if drift["unit"] else "left alone"
        end = f"fault after {drift['ticks_to_fault']:,}" if drift["ticks_to_fault"] else "no fault"
        what = "; ".join(drift["failed"]) or "as it should be"
        lines.append(("drift", f"quaternion {how}, {drift['ticks']:,} ticks: {end}, {what}"))
    for check, count in summary["violations_by_check"].items():
        lines.append(("VIOLATED", f"{check}: {count}"))
    lines.append(
        ("violations", f"{summary['violations']} of {summary['cases']:,}, {folder / SUMMARY}")
    )
    print_lines(lines)
    for v in summary["listed"][:SHOWN]:
        print(f"  {v['check']}, {v['scene']}, case {v['case']}: {v['text']}")
