"""The command `crease`: one module of crease.verbs for each verb.

Exit status: 0 done; 1 with one line `error: ...` on stderr; 2 the same for a wrong command line; 4 a
servo that stopped in fault, as of creased; an interrupt ends the process as its signal does, 130 to a shell.
"""

from __future__ import annotations

import argparse
import errno
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from crease.base.errors import CreaseError, UsageError
from crease.base.settings import command_line
from crease.base.version import VERSION

VERBS = (
    *("check", "bake", "info", "replay", "plot", "view", "export"),
    *("experiment", "bench", "stress", "sim", "bus", "hil"),
)
"""In the order of the work: what `crease --help` lists."""


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line, as every error is said, and where to read on."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As ever; a verb refuses by itself what it does not know, and so names itself and not `crease`."""
        known, rest = super().parse_known_args(args, namespace)
        if rest and self._subparsers is None:
            self.error(self._unknown(rest))
        return known, rest

    def error(self, message: str) -> NoReturn:
        """Ends with status 2."""
        print(f"error: {_plain(message)}; see `{self.prog} --help`", file=sys.stderr)
        raise SystemExit(2)

    def _unknown(self, words: list[str]) -> str:
        from difflib import get_close_matches

        word = words[0]
        if not word.startswith("-"):
            return f"'{word}' is one argument too many"
        near = get_close_matches(word.split("=")[0], list(self._option_string_actions), 1)
        return f"there is no option {word}" + (f", perhaps {near[0]}" if near else "")


_MISSING = "the following arguments are required: "


def _plain(message: str) -> str:
    """What argparse says, in the words of this program."""
    if message.startswith(_MISSING):
        names = message.removeprefix(_MISSING).split(", ")
        short = ", ".join(name.split("/")[0] for name in names)
        return f"{short} {'is' if len(names) == 1 else 'are'} missing"
    message = message.removeprefix("argument ")
    if message.startswith("VERB: invalid choice: "):
        word = message.split("'")[1]
        return f"there is no verb '{word}'; the verbs are {', '.join(VERBS)}"
    what, _, known = message.removesuffix(")").partition(" (choose from ")
    if known:
        known = known.replace("'", "")
        return f"{what.replace('invalid choice: ', '')} is not known; use {known}"
    return message


def make_parser(verbs: Sequence[str] = VERBS) -> argparse.ArgumentParser:
    """The parser of the whole command line, or of some verbs: what the others need is not loaded."""
    parser = Parser(
        prog="crease",
        description="Stable haptic contact between a rigid tool and a rigid mock-up.",
        epilog="`crease VERB --help` tells what a verb takes. Lengths have a unit, such as 2mm. Exit status: 0 done, "
        "1 an error, 2 a wrong command line, 4 a servo that stopped in fault (hil), 130 interrupted.",
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
            status = args.run(args)
            sys.stdout.flush()
            return int(status or 0)
    except UsageError as error:
        print(f"error: {error}; see `crease {words[0]} --help`", file=sys.stderr)
        return 2
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("error: the machine has not enough memory for this", file=sys.stderr)
        return 1
    except OSError as error:
        where = error.filename or ("standard output" if error.errno in _OF_WRITING else "")
        # What is left in the buffer would fail again at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            print(f"error: {where}{': ' * bool(where)}{error.strerror or error}", file=sys.stderr)
        return 1


_OF_WRITING = {errno.EBADF, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOSPC}
"""Where no file is named, it is standard output that cannot be written: outputs are named."""


def main(argv: Sequence[str] | None = None) -> int:
    """The same for a program that goes on afterwards: an interrupt is an error too."""
    try:
        return run_line(argv)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return 128 + signal.SIGINT
