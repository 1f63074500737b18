"""The command `crease`: one module of crease.verbs for each verb.

Exit status: 0 done; 1 with one line `error: ...` on stderr; 2 for a wrong command line.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from crease.base.errors import CreaseError
from crease.base.settings import command_line
from crease.base.version import VERSION
from crease.verbs import (
    bake,
    bench,
    bus,
    check,
    experiment,
    export,
    hil,
    info,
    plot,
    replay,
    sim,
    stress,
    view,
)

VERBS = (check, bake, info, replay, plot, view, export, experiment, bench, stress, sim, bus, hil)
"""In the order of the work: what `crease --help` lists."""


def make_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="crease",
        description="Stable haptic contact between a rigid tool and a rigid mock-up.",
    )
    parser.add_argument("--version", action="version", version=f"crease {VERSION}")
    sub = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for verb in VERBS:
        verb.add_parser(sub)
    return parser


def run_line(argv: Sequence[str] | None = None) -> int:
    """Run one command line and give its exit status.   Errors: KeyboardInterrupt."""
    try:
        args = make_parser().parse_args(argv)
        with command_line():
            args.run(args)
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """The same for a program that goes on afterwards: an interrupt is an error too."""
    try:
        return run_line(argv)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return 1
