"""The command `crease`, as `python -m crease` too. Nothing heavy is imported before an interrupt is heard."""

import io
import os
import sys
from contextlib import suppress

from crease.base import ending


def main() -> int:
    """Run the command line and give its exit status."""
    ending.hear()
    _open_streams()
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # letters that the terminal has not
    try:
        return _run()
    finally:
        ending.be_deaf()


def _open_streams() -> None:
    """A stream that the command was started without (`>&-`) goes nowhere; its number is left to no other file."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def _run() -> int:
    from crease.base.errors import CreaseError

    try:
        from crease.cli import parser_for, run_line

        parser = parser_for(sys.argv[1:])
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    try:
        return run_line(parser=parser)
    except KeyboardInterrupt:
        # The interpreter's own end would wait for threads.
        with suppress(OSError):
            sys.stdout.flush()
        ending.end()
        raise


if __name__ == "__main__":
    sys.exit(main())
