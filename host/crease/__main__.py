"""The command `crease`, as `python -m crease` too. Nothing heavy is imported before an interrupt is heard."""

import os
import signal
import sys
from types import FrameType


def _leave(_number: int, _frame: FrameType | None) -> None:
    """Ctrl-C while the modules load: nothing is open yet, and an exception in the middle of an import is anybody's."""
    os.write(2, b"error: interrupted\n")
    os._exit(1)


def main() -> int:
    """Run the command line and give its exit status."""
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heard:
        signal.signal(signal.SIGINT, _leave)
    from crease.base.errors import CreaseError

    try:
        from crease.cli import main as run
    except CreaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    finally:
        if heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


if __name__ == "__main__":
    sys.exit(main())
