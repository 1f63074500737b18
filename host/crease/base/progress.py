"""A progress bar on stderr, for people: nothing is shown to files and pipes, nor for work under a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

_WIDTH = 30
_DELAY_S = 1.0
_REDRAW_S = 0.1


class Progress:
    """A bar that appears when the work takes over a second, and leaves no trace. Use it in a `with`."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._live = self._stream.isatty()
        self._start_s = time.monotonic()
        self._drawn_s = 0.0
        self._shown = False
        self._label = ""
        self._label_s = self._start_s

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def __call__(self, label: str, part: float) -> None:
        """Show that `part` (0..1) of the work `label` is done."""
        now_s = time.monotonic()
        if label != self._label:
            self._label, self._label_s = label, now_s
        if not self._live or now_s - self._start_s < _DELAY_S or now_s - self._drawn_s < _REDRAW_S:
            return
        part = min(max(part, 0.0), 1.0)
        bar = "#" * round(part * _WIDTH)
        left = _left_text(now_s - self._label_s, part)
        self._stream.write(f"\r\x1b[K{label:<18.18s} [{bar:<{_WIDTH}s}] {part:4.0%}{left}")
        self._stream.flush()
        self._drawn_s = now_s
        self._shown = True


def _left_text(spent_s: float, part: float) -> str:
    """How long a work takes on, by what it took so far; nothing while that says little."""
    if spent_s < _DELAY_S or part < 0.05 or part >= 1.0:
        return ""
    return f", {spent_s * (1.0 - part) / part:.0f} s left"


def part_of(tick: Callable[[float], None], done: float, share: float) -> Callable[[float], None]:
    """Progress of a part of the work, of which some was done before."""
    return lambda part: tick(done + share * part)
