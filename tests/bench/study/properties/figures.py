"""Figures: every scene and property of a response as a field of numbers, and run time against what is kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import machine

from study.labels import spread_labels
from study.properties.checks import CHECKS
from study.properties.judge import Row
from study.properties.tables import Record, kept_share, median_us, read_csv, to_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEADS = {
    "P1": "flat",
    "P2": "clears",
    "P3": "continuous",
    "P4": "idempotent",
    "P5": "walls apart",
    "P6": "energy",
    "P7": "balance,\nghosts, misses",
    "P8": "torque",
    "P9": "amplification",
}
PATHS_SHOWN = (
    "over_edge_1",
    "over_edge_10",
    "pads4_one_by_one",
    "legs_floor",
    "pocket",
    "ball_pin",
)
SHOWN = ("way_out", "extent", "published", "fixed45", "sphere_proxy")
"""Scenes and responses of the figure of forces along the path: those whose way out is known at every tick."""
KEPT, BROKEN, UNASKED = "#009E73", "#D55E00", "#f4f4f4"
LIBRARIES = ("ODE", "libccd", "Bullet GImpact", "Bullet hull", "MuJoCo SDF", "FCL", "Coal")
FAR = 100.0
"""From this many times the bound on, the colour is full."""


def draw_scenes(rows: Sequence[Row], response: str) -> Figure:
    """A line for each scene, a column for each property: value over bound, green when kept."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(9.4, 0.215 * len(rows) + 1.6)
        axes = figure.subplots()
        axes.grid(False)
        for y, row in enumerate(rows):
            excess, verdicts = row.excess(), row.verdicts()
            if y and row.scene.family != rows[y - 1].scene.family:
                axes.axhline(y - 0.5, color="#888888", lw=0.8)
            for x, name in enumerate(CHECKS):
                _cell(axes, x, y, excess.get(name), verdicts.get(name, False))
        axes.set_xlim(-0.5, len(CHECKS) - 0.5)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xticks(range(len(CHECKS)), [f"{n}\n{HEADS[n]}" for n in CHECKS])
        axes.set_yticks(range(len(rows)), [row.scene.name for row in rows])
        axes.tick_params(length=0, labelsize=7.5)
        axes.xaxis.tick_top()
        for side in axes.spines.values():
            side.set_visible(False)
        share = kept_share(read_csv(to_csv(rows)))
        figure.suptitle(
            f"{response}: largest value over its bound; {100 * share:.0f} % of all ratings kept",
            fontsize=11,
        )
    return figure


def _cell(axes: Axes, x: int, y: int, excess: float | None, kept: bool) -> None:
    """Value over bound; `silent` where it would be kept by a response that says nothing."""
    from matplotlib.patches import Rectangle

    def fill(colour: str, strength: float) -> None:
        axes.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, fc=colour, alpha=strength, lw=0))

    if excess is None:
        fill(UNASKED, 1.0)
        return
    steep = 0.25 + 0.75 * math.log(max(excess, 1.0)) / math.log(FAR)
    fill(KEPT if kept else BROKEN, 0.35 if kept else min(steep, 1.0))
    text = f"{excess:,.0f}" if excess >= 10 else f"{excess:.1f}" if excess > 1 else f"{excess:.2f}"
    if excess <= 1.0 and not kept:
        text = "silent"
    axes.text(x, y, text, ha="center", va="center", fontsize=7, color="#222222")


def draw_paths(rows: Sequence[Row], responses: Sequence[str]) -> Figure | None:
    """Size of the force along the paths of PATHS_SHOWN, a line for each response; none when no such scene is there."""
    import matplotlib as mpl

    names = [name for name in PATHS_SHOWN if any(row.scene.name == name for row in rows)]
    if not names:
        return None
    with mpl.rc_context(STYLE):
        columns = min(2, len(names))
        lines = -(-len(names) // columns)
        figure = new_figure(5.6 * columns, 2.5 * lines + 0.6)
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for panel, name in zip(panels, names, strict=False):
            for row in rows:
                if row.scene.name == name and row.response in responses:
                    size = np.linalg.norm(row.way_mm, axis=1)
                    colour = COLOURS[list(responses).index(row.response) % len(COLOURS)]
                    wide = 3.2 if row.response == SHOWN[0] else 1.2
                    share = np.linspace(0, 100, len(size))
                    panel.plot(share, size, color=colour, lw=wide, label=row.response)
            panel.set_title(row_about(rows, name), fontsize=8.5, loc="left")
            panel.set_ylim(bottom=0.0)
            panel.set_ylabel("|F| / k, mm")
        for panel in panels[len(names) :]:
            panel.set_visible(False)
        for panel in panels[: len(names)][-columns:]:
            panel.set_xlabel("share of the path, %")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def row_about(rows: Sequence[Row], name: str) -> str:
    """What a scene is, from its table."""
    return next(row.scene.about for row in rows if row.scene.name == name)


def draw_time(records: Sequence[Record]) -> Figure:
    """Share of the ratings that are kept against the time of a tick: a star for the first response, else a dot.

    records: as `tables.to_csv` writes them.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(8.6, 5.4)
        axes = figure.subplots()
        marks: list[tuple[tuple[float, float], tuple[str, str]]] = []
        for i, name in enumerate(dict.fromkeys(r["response"] for r in records)):
            mine = [r for r in records if r["response"] == name]
            place = median_us(mine), 100.0 * kept_share(mine)
            colour = COLOURS[i % len(COLOURS)]
            size, marker = (190, "*") if i == 0 else (60, "X" if name in LIBRARIES else "o")
            axes.scatter(*place, s=size, marker=marker, color=colour, lw=0, zorder=3)
            marks.append((place, (name, colour)))
        times = [place[0] for place, _ in marks]
        low_us, high_us = 0.7 * min(times), 3.0 * max(times)
        axes.set_xscale("log")
        axes.set_xlim(low_us, high_us)
        across = math.log(high_us / low_us)
        places = [(math.log(us / low_us) / across, 0.01 * share) for (us, share), _ in marks]
        spread_labels(axes, places, [label for _, label in marks])
        axes.set_ylim(0.0, 100.0)
        axes.set_xlabel("time of a tick in contact, us (median scene; libraries: of a query)")
        axes.set_ylabel("scenes and properties kept, %")
        axes.set_title(
            f"Run time against properties: up and left is better\n{machine()}", fontsize=10
        )
    return figure
