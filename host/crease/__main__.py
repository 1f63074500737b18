"""The command `crease`, as `python -m crease` too. Nothing heavy is imported before an interrupt is heard."""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn


def _leave(_number: int = signal.SIGINT, _frame: FrameType | None = None) -> NoReturn:
    """Interrupted: the end, at once. While modules load nothing is open, and an exception in an import is anybody's."""
    os.write(2, b"error: interrupted\n")
    os._exit(1)


def main() -> int:
    """Run the command line and give its exit status."""
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heard:
        signal.signal(signal.SIGINT, _leave)
    from crease.base.errors import CreaseError

    try:
        from crease.cli import parser_for, run_line

        parser = parser_for(sys.argv[1:])
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    finally:
        if heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return run_line(parser=parser)
    except KeyboardInterrupt:
        # What was begun is taken away. The interpreter's own end would wait for threads, and crash in a library
        # that was interrupted as it loaded.
        with suppress(OSError):
            sys.stdout.flush()
        _leave()


if __name__ == "__main__":
    sys.exit(main())
