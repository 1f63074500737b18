"""How the command ends when it is told to, by SIGINT, SIGTERM or a terminal that closes, wherever it is.

Nothing is raised there: an exception out of a signal breaks what is being imported, down to crashes of extensions. What
was begun is undone, and the process ends at once.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

SIGNALS: dict[int, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}
"""What ends the command, and what Python does with it."""

_begun: list[Callable[[], object]] = []
_steady: list[None] = []
_heard: list[int] = []


def end(number: int = signal.SIGINT, _frame: FrameType | None = None) -> None:
    """End the process, with what was begun undone; within `steady` as soon as that is left."""
    if _steady:
        _heard.append(number)
        return
    for undo in reversed(_begun):
        with suppress(Exception):  # one that fails keeps no other
            undo()
    with suppress(OSError):
        os.write(2, b"error: interrupted\n")
    _die(number)


def _die(number: int) -> None:
    """By the signal itself, which shells and supervisors ask for: 130 and 143 to a shell, and its loop ends too."""
    with suppress(ValueError):  # not the main thread
        signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    os._exit(128 + number)  # the first process of a container does not die of its own signals


def hear() -> None:
    """From now on the signals end the process so, unless it was started with others in mind."""
    for number, usual in SIGNALS.items():
        if signal.getsignal(number) is usual:
            signal.signal(number, end)


def be_deaf() -> None:
    """The work is done: a signal that comes now no longer makes it undone."""
    for number in SIGNALS:
        if signal.getsignal(number) is end:
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def raising() -> Iterator[None]:
    """Within this the signals raise KeyboardInterrupt: for work that an interrupt ends in its own way."""
    heard = [number for number in SIGNALS if signal.getsignal(number) is end]
    for number in heard:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, end)


@contextmanager
def steady() -> Iterator[None]:
    """Within this, which must be short, nothing ends: for steps that belong together."""
    _steady.append(None)
    try:
        yield
    finally:
        _steady.pop()
        if _heard and not _steady:
            end(_heard[0])


@contextmanager
def undone_by(undo: Callable[[], object]) -> Iterator[None]:
    """An end within this calls `undo`."""
    _begun.append(undo)
    try:
        yield
    finally:
        _begun.remove(undo)
