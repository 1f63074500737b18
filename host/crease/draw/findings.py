"""The picture of `crease check`: meshes with what was found in them marked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crease.bake.check import Findings
from crease.base.table import write_atomic
from crease.base.units import unit_name
from crease.draw.plot import plain, quiet_glyphs

MARKS_MAX = 2000
"""Places of one kind that are marked."""
LINES_MAX = 20_000
"""Creases that are drawn."""


def draw_findings(findings: list[Findings], path: Path) -> None:
    """A picture of the meshes with what was found marked.   Errors: CreaseError when it cannot be written."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    columns = min(3, len(findings))
    rows = -(-len(findings) // columns)
    figure = plt.figure(figsize=(6 * columns, 5.4 * rows), layout="constrained")
    for i, one in enumerate(findings):
        _draw_one(figure.add_subplot(rows, columns, i + 1, projection="3d"), one)
    try:
        with quiet_glyphs():
            write_atomic(path, lambda file: figure.savefig(file, format="png", dpi=110))
    finally:
        plt.close(figure)


def _draw_one(axes: Any, one: Findings) -> None:
    from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
        Line3DCollection,
        Poly3DCollection,
    )

    unit = one.unit_m
    shown = one.triangles[:: max(1, len(one.triangles) // 20_000)]
    axes.add_collection3d(
        Poly3DCollection(one.vertices_m[shown] / unit, facecolor="#c8ccd4", alpha=0.35)
    )
    if len(one.creases_m):
        lines = one.creases_m[:LINES_MAX] / unit
        axes.add_collection3d(Line3DCollection(lines, colors="#3c4048", linewidths=0.7))
    if len(one.open_edges_m):
        edges = one.open_edges_m[:MARKS_MAX] / unit
        axes.add_collection3d(Line3DCollection(edges, colors="#d62728", linewidths=1.5))
    marks = (
        ("open", one.open_edges_m.mean(axis=1)[:1], "#d62728", "o"),
        ("turned", one.turned_edges_m.mean(axis=1)[:MARKS_MAX], "#9467bd", "."),
        ("crossing", one.crossings_m[:MARKS_MAX], "#ff7f0e", "x"),
        ("thinnest wall", one.wall_at_m, "#1f77b4", "v"),
        ("sharpest edge", one.sharpest_at_m, "#2ca02c", "^"),
    )
    for label, points, colour, marker in marks:
        if len(points):
            axes.scatter(*(points / unit).T, c=colour, marker=marker, s=30, label=label)
    low, high = one.vertices_m.min(axis=0) / unit, one.vertices_m.max(axis=0) / unit
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    name = unit_name(unit)
    axes.set(xlabel=f"x, {name}", ylabel=f"y, {name}", zlabel=f"z, {name}")
    axes.set_box_aspect(np.maximum(high - low, 1e-9))
    axes.set_title(plain(Path(one.source).name), fontsize=10)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, loc="upper left")
