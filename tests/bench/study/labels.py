"""Labels beside their marks, clear of each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABEL_HEIGHT, LETTER_WIDTH, LABEL_GAP = 0.055, 0.0118, 0.016
"""Size of a label and its distance from the mark, in shares of a panel."""


def _slots(x: float, y: float, width: float) -> Iterator[tuple[float, float, bool]]:
    """Near end and middle of a label, and whether it ends there: beside its mark first, then up and down."""
    for step in range(40):
        for sign in (1, -1) if step else (1,):
            middle = y + 0.35 * sign * step * LABEL_HEIGHT
            if 0.5 * LABEL_HEIGHT < middle < 1.0:
                yield x + LABEL_GAP, middle, False
                if x - LABEL_GAP - width > 0.0:
                    yield x - LABEL_GAP, middle, True


def _box(slot: tuple[float, float, bool], width: float) -> tuple[float, float, float, float]:
    near, middle, is_left = slot
    left = near - width if is_left else near
    return left, left + width, middle - LABEL_HEIGHT / 2, middle + LABEL_HEIGHT / 2


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]


def spread_labels(
    axis: Axes, places: Sequence[tuple[float, float]], labels: Sequence[tuple[str, str]]
) -> None:
    """Text and colour of each mark beside it, clear of other labels and marks, by the size of a letter on these panels.

    Shapes: places of the marks in shares of the panel, from its lower left.
    """
    taken = [(x - 0.009, x + 0.009, y - 0.02, y + 0.02) for x, y in places]
    for (text, colour), (x, y) in sorted(
        zip(labels, places, strict=True), key=lambda pair: pair[1][1]
    ):
        if not text:
            continue
        width = LETTER_WIDTH * len(text)
        free = (
            s
            for s in _slots(x, y, width)
            if not any(_overlap(_box(s, width), box) for box in taken)
        )
        slot = next(free, (x + LABEL_GAP, y, False))
        taken.append(_box(slot, width))
        line = {"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 0, "shrinkB": 2}
        axis.annotate(text, (x, y), slot[:2], xycoords="axes fraction", textcoords="axes fraction", fontsize=7.5,
                      color=colour, va="center", ha="right" if slot[2] else "left",
                      arrowprops=line if abs(slot[1] - y) > 0.6 * LABEL_HEIGHT and y > 0 else None)  # fmt: skip
