"""The command `crease`: one module of crease.verbs for each verb.

Exit status: 0 done; 1 with one line `error: ...` on stderr; 2 for a wrong command line.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from crease.base.errors import CreaseError
from crease.base.settings import command_line
from crease.base.version import VERSION

VERBS = (
    *("check", "bake", "info", "replay", "plot", "view", "export"),
    *("experiment", "bench", "stress", "sim", "bus", "hil"),
)
"""In the order of the work: what `crease --help` lists."""


def make_parser(verbs: Sequence[str] = VERBS) -> argparse.ArgumentParser:
    """The parser of the whole command line, or of some verbs: what the others need is not loaded."""
    parser = argparse.ArgumentParser(
        prog="crease",
        description="Stable haptic contact between a rigid tool and a rigid mock-up.",
    )
    parser.add_argument("--version", action="version", version=f"crease {VERSION}")
    sub = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for verb in verbs:
        import_module(f"crease.verbs.{verb}").add_parser(sub)
    return parser


def parser_for(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser that a command line of these words needs."""
    return make_parser(words[:1] if words and words[0] in VERBS else VERBS)


def run_line(
    argv: Sequence[str] | None = None, parser: argparse.ArgumentParser | None = None
) -> int:
    """Run one command line and give its exit status.   Errors: KeyboardInterrupt."""
    words = sys.argv[1:] if argv is None else argv
    try:
        args = (parser or parser_for(words)).parse_args(words)
        with command_line():
            args.run(args)
            sys.stdout.flush()
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("error: the machine has not enough memory for this", file=sys.stderr)
        return 1
    except OSError as error:
        # What is left in the buffer would fail again at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            print(
                f"error: {error.filename or 'standard output'}: {error.strerror}", file=sys.stderr
            )
        return 1
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """The same for a program that goes on afterwards: an interrupt is an error too."""
    try:
        return run_line(argv)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return 1
