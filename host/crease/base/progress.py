"""A progress bar on stderr, for people: nothing is shown to files and pipes, nor for work under a second."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from crease.base.ending import undone_by

_WIDTH = 30
_DELAY_S = 1.0
_REDRAW_S = 0.1
_PREPARED = 0.1
"""Part of the bar for what comes before anything can be foreseen."""
_PRIOR_S = 0.5
"""Work that this machine counts as having done as fast as the weights say, before it has shown its own pace."""


class Progress:
    """A bar that appears when the work takes over a second, and leaves no trace. Use it in a `with`."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self.live = self._stream.isatty()
        self._start_s = time.monotonic()
        self._drawn_s = 0.0
        self._shown = False
        self._label = ""
        self._label_s = self._start_s

    def __enter__(self) -> Progress:
        self._undo = undone_by(self._erase)
        self._undo.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.__exit__(None, None, None)
        self._erase()

    def _erase(self) -> None:
        if self._shown:
            self._stream.flush()
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def __call__(self, label: str, part: float, left_s: float | None = None) -> None:
        """Show that `part` (0..1) is done, now at `label`. left_s: that it takes on; None: as `label` took so far."""
        now_s = time.monotonic()
        if label != self._label:
            self._label, self._label_s = label, now_s
        if not self.live or now_s - self._start_s < _DELAY_S or now_s - self._drawn_s < _REDRAW_S:
            return
        part = min(max(part, 0.0), 1.0)
        bar = "#" * round(part * _WIDTH)
        if left_s is None:
            left = _left_text(now_s - self._label_s, part)
        else:
            left = f", {left_s:.0f} s left" if math.isfinite(left_s) else ""
        self._stream.write(f"\r\x1b[K{label:<18.18s} [{bar:<{_WIDTH}s}] {part:4.0%}{left}")
        self._stream.flush()
        self._drawn_s = now_s
        self._shown = True


@dataclass
class _Stage:
    """A stage of a work: units of it, and seconds that one takes where the weights were measured."""

    units: float
    unit_s: float

    @property
    def work_s(self) -> float:
        return self.units * self.unit_s


Tell = Callable[[str, float, float], None]


class Forecast:
    """What is left of a work of several stages: their units by weights, and how fast this machine was so far.

    tell(label, part, left_s) is called at every step: part of the whole work, never falling; seconds that it takes on,
    infinite before all stages are foreseen. heard: whether anybody wants to know: looking ahead takes time.
    """

    def __init__(
        self,
        tell: Tell = lambda *_: None,
        clock: Callable[[], float] = time.monotonic,
        *,
        heard: bool = True,
    ) -> None:
        self._tell, self.clock, self.heard = tell, clock, heard
        self._ahead: dict[str, _Stage] = {}
        self._complete = False
        self._done_s = self._spent_s = 0.0
        self._name, self._now, self._part, self._shown = "", _Stage(0.0, 0.0), 0.0, 0.0
        self._began_s = clock()

    def prepare(self, label: str, part: float) -> None:
        """Tell of what comes before anything can be foreseen: up to _PREPARED of the bar."""
        self._shown = max(self._shown, _PREPARED * part)
        self._tell(label, self._shown, math.inf)

    def foresee(self, name: str, units: float, unit_s: float) -> None:
        """A stage ahead. unit_s: seconds that one of its units takes where the weights were measured."""
        self._ahead[name] = _Stage(float(units), float(unit_s))

    def complete(self) -> None:
        """All stages ahead are foreseen: from now on the part done and the seconds left are told."""
        self._complete = True

    def begin(self, name: str, units: float | None = None) -> None:
        """Go on to a stage, those before being done. units: as counted by now; None: as foreseen."""
        self._done_s += self._now.work_s
        if self._name:
            self._spent_s += self.clock() - self._began_s
        self._began_s, self._part = self.clock(), 0.0
        self._name, self._now = name, self._ahead.pop(name, _Stage(0.0, 0.0))
        if units is not None:
            self._now.units = units
        self.tick(0.0)

    def tick(self, part: float) -> None:
        """`part` (0..1) of this stage is done."""
        self._part = part
        done_s = self._done_s + self._now.work_s * part
        total_s = self._done_s + self._now.work_s + self.ahead_s()
        if self._complete and total_s > 0:
            self._shown = max(self._shown, done_s / total_s)
        self._tell(self._name, self._shown, self.left_s() if self._complete else math.inf)

    def end(self) -> None:
        """All is done."""
        self._ahead.clear()
        self.tick(1.0)
        self._shown = 1.0
        self._tell(self._name, 1.0, 0.0)

    def ahead_s(self) -> float:
        """Work of the stages that have not begun, s."""
        return sum(stage.work_s for stage in self._ahead.values())

    def pace(self) -> float:
        """Seconds that a second of work took on this machine so far."""
        spent_s = self._spent_s + self.clock() - self._began_s
        return (_PRIOR_S + spent_s) / (_PRIOR_S + self._done_s + self._now.work_s * self._part)

    def left_s(self) -> float:
        """Seconds that it takes on: this stage at its own pace, the others at that of all."""
        spent_s, done_s = self.clock() - self._began_s, self._now.work_s * self._part
        pace = self.pace()
        own = (_PRIOR_S * pace + spent_s) / (_PRIOR_S + done_s)
        return own * (self._now.work_s - done_s) + pace * self.ahead_s()


def _left_text(spent_s: float, part: float) -> str:
    """How long a work takes on, by what it took so far; nothing while that says little."""
    if spent_s < _DELAY_S or part < 0.05 or part >= 1.0:
        return ""
    return f", {spent_s * (1.0 - part) / part:.0f} s left"


def part_of(tick: Callable[[float], None], done: float, share: float) -> Callable[[float], None]:
    """Progress of a part of the work, of which some was done before."""
    return lambda part: tick(done + share * part)
