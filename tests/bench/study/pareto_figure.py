"""The figures of run time against error: a row for each path, force on the left, direction on the right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import machine

from study.labels import spread_labels
from study.points import OURS, Point
from study.sweeps import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GROUPS = {
    OURS: ("*", COLOURS[1], 190),
    "voxel size": ("s", COLOURS[0], 42),
    "sample spacing": ("o", COLOURS[2], 42),
    "tessellation": ("^", COLOURS[5], 46),
    "contact zones": ("P", COLOURS[6], 60),
    "rival response": ("D", COLOURS[3], 46),
    "rival library": ("X", COLOURS[7], 62),
    "exact boolean": ("h", COLOURS[4], 80),
}
"""Marker, colour and size of each group."""

UNLABELLED = ("voxel size", "tessellation")
"""Marks that lie on top of the default's: the legend tells them."""

MEASURES = {
    "force_rms_mm": "force error, mm RMS (|F - F*| / k)",
    "direction_p99_deg": "direction error, deg (99th percentile)",
}
ROW_INCHES = 4.3

Ends = tuple[float, float]


def draw(points: list[Point], sweeps: Sequence[Sweep]) -> Figure:
    """Marks of these paths. All panels share the axis of time."""
    import matplotlib as mpl

    points = [p for p in points if p.scene in {s.path for s in sweeps}]
    times = [p.p50_us for p in points]
    x_range = 0.5 * min(times), 9.0 * max(times)
    with mpl.rc_context(STYLE):
        figure = new_figure(13.0, ROW_INCHES * len(sweeps) + 0.8)
        axes = figure.subplots(len(sweeps), len(MEASURES), sharex=True, squeeze=False)
        for row, sweep in zip(axes, sweeps, strict=True):
            here = [p for p in points if p.scene == sweep.path]
            for axis, (key, label) in zip(row, MEASURES.items(), strict=True):
                _panel(axis, here, key, x_range, _limits(here, key))
                axis.set_ylabel(label)
            row[0].set_title(f"{sweep.path}: {sweep.about}", loc="left")
        for axis in axes[-1]:
            axis.set_xlabel("time of a tick in contact, us (median; libraries: of a query)")
        handles = [
            axes[0, 0].scatter([], [], marker=m, color=c, s=s, label=name)
            for name, (m, c, s) in GROUPS.items()
            if any(p.group == name for p in points)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
        figure.suptitle(
            f"Run time against error: down and left is better ({machine()})", fontsize=11
        )
    return figure


def _limits(points: list[Point], key: str) -> Ends:
    """Both ends of a log axis that holds every point but the exact ones, with room."""
    values = [getattr(p, key) for p in points if p.group != "exact boolean"]
    values = [v for v in values if v > 0]
    return 0.35 * min(values), 3.0 * max(values)


def _panel(axis: Axes, points: list[Point], key: str, x_range: Ends, y_range: Ends) -> None:
    """Marks, a line through the spacings, the exact boolean on the floor, and labels clear of each other."""
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(*x_range)
    axis.set_ylim(*y_range)
    spacings = sorted(
        (p.spacing_mm, p.p50_us, getattr(p, key))
        for p in points
        if p.group in (OURS, "sample spacing")
    )
    axis.plot(
        [s[1] for s in spacings],
        [s[2] for s in spacings],
        color=GROUPS["sample spacing"][1],
        lw=1.0,
        zorder=2,
    )
    marks = []
    for p in points:
        value = y_range[0] if p.group == "exact boolean" else getattr(p, key)
        if not value > 0:
            continue
        marker, colour, size = GROUPS[p.group]
        axis.scatter(
            p.p50_us, value, marker=marker, color=colour, s=size, zorder=3, lw=0, clip_on=False
        )
        marks.append((p.p50_us, value, "" if p.group in UNLABELLED else p.label, colour))
    places = [(_share(x, x_range), _share(y, y_range)) for x, y, _, _ in marks]
    spread_labels(axis, places, [mark[2:] for mark in marks])


def _share(value: float, ends: Ends) -> float:
    return math.log(value / ends[0]) / math.log(ends[1] / ends[0])
