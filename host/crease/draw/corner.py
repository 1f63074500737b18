"""The picture of the method: force arrows round a corner, ours and the one it is compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from crease.draw.plot import STYLE, new_figure
from crease.mesh.mesh import Mesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = npt.NDArray[np.float64]

ARROWS = 46
"""Arrows along the path: dense enough to see the direction turn, far enough apart to tell them apart."""

ARROW_LENGTH_MM = 42.0
"""Length of the longest arrow of all panels: one scale, so that sizes can be compared between them."""

TOOLS_AT = (0.15, 0.5, 0.85)
"""Where the tool is drawn: share of the way."""

_BLOCK, _EDGE, _PATH, _FORCE, _TOOL = "#e6ecf2", "#33506b", "#8a8a8a", "#c23b22", "#7a9cc6"
_CASE_COLOURS = ("#0072B2", "#D55E00", "#009E73")


@dataclass(frozen=True)
class CornerCase:
    """One way to answer a path: name, tool origin (n, 3) in m, force (n, 3) in N."""

    name: str
    position_m: Floats
    force_N: Floats


def section_xz(mesh: Mesh, y_m: float = 0.0) -> list[Floats]:
    """Outlines of a mesh cut by the plane y = y_m: each (k, 2), x and z in m."""
    from crease.mesh.mend import to_manifold

    turned = np.stack(
        [mesh.vertices_m[:, 0], mesh.vertices_m[:, 2], -mesh.vertices_m[:, 1]], axis=1
    )
    cut = to_manifold(turned, mesh.triangles).slice(-y_m)
    return [np.asarray(outline, dtype=np.float64) for outline in cut.to_polygons()]


def draw_corner(cases: Sequence[CornerCase], outlines: Sequence[Floats], radius_m: float) -> Figure:
    """The corner in the x-z plane, a panel for each case, and the angle of the force over the path below.

    Units: outlines in m as from section_xz; radius_m of the round tool, drawn at both ends and the middle.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        window = _window(cases, radius_m)
        wide_mm, high_mm = window[1] - window[0]
        panel_in = 4.4 * high_mm / wide_mm  # as high as its scale asks, else white is left above
        figure = new_figure(5.0 * len(cases), panel_in + 3.0)
        grid = figure.add_gridspec(2, len(cases), height_ratios=[panel_in, 1.7])
        longest_N = max(float(np.linalg.norm(case.force_N, axis=1).max()) for case in cases)
        scale_mm_N = ARROW_LENGTH_MM / max(longest_N, 1e-9)
        for column, case in enumerate(cases):
            axes = figure.add_subplot(grid[0, column])
            _draw_case(axes, case, outlines, radius_m, scale_mm_N)
            _frame(axes, window)
        _draw_angles(figure.add_subplot(grid[1, :]), cases)
    return figure


def _window(cases: Sequence[CornerCase], radius_m: float) -> tuple[Floats, Floats]:
    """Low and high corner of the view, mm: the path with room for arrows and tool."""
    points = 1e3 * np.concatenate([case.position_m[:, [0, 2]] for case in cases])
    room = max(1.15 * ARROW_LENGTH_MM, 1.02e3 * radius_m)
    return points.min(axis=0) - room, points.max(axis=0) + room


def _draw_case(
    axes: Axes,
    case: CornerCase,
    outlines: Sequence[Floats],
    radius_m: float,
    scale_mm_N: float,
) -> None:
    from matplotlib.patches import Circle, Polygon

    for outline in outlines:
        axes.add_patch(Polygon(1e3 * outline, closed=True, fc=_BLOCK, ec=_EDGE, lw=1.8, zorder=1))
    path_mm = 1e3 * case.position_m[:, [0, 2]]
    touching = np.flatnonzero(np.linalg.norm(case.force_N, axis=1) > 0.0)
    axes.plot(*path_mm.T, color=_PATH, lw=1.0, ls=(0, (4, 2)), zorder=2)
    if len(touching):
        for i in touching[[int(share * (len(touching) - 1)) for share in TOOLS_AT]]:
            axes.add_patch(
                Circle(
                    tuple(path_mm[i]), 1e3 * radius_m, fc=_TOOL, ec=_EDGE, alpha=0.16, zorder=1.5
                )
            )
        _draw_arrows(axes, path_mm, case.force_N[:, [0, 2]], touching, scale_mm_N)
    axes.set_title(case.name)


def _frame(axes: Axes, window: tuple[Floats, Floats]) -> None:
    axes.set_aspect("equal")
    axes.set_xlim(window[0][0], window[1][0])
    axes.set_ylim(window[0][1], window[1][1])
    axes.set_xlabel("x, mm")
    axes.set_ylabel("z, mm")
    axes.grid(False)


_ARROW: dict[str, Any] = {
    "angles": "xy",
    "scale_units": "xy",
    "scale": 1.0,
    "width": 0.0042,
    "headwidth": 3.6,
    "headlength": 4.5,
    "headaxislength": 4.2,
    "color": _FORCE,
}


def _draw_arrows(
    axes: Axes,
    path_mm: Floats,
    force_N: Floats,
    touching: npt.NDArray[np.int64],
    scale_mm_N: float,
) -> None:
    """Force arrows at even distances along the path where the tool touches, and one of known size."""
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path_mm[touching], axis=0), axis=1))]
    even = np.searchsorted(way, np.linspace(0.0, way[-1], ARROWS))
    chosen = touching[even.clip(max=len(touching) - 1)]
    arrows_mm = scale_mm_N * force_N[chosen]
    drawn = axes.quiver(*path_mm[chosen].T, *arrows_mm.T, zorder=3, **_ARROW)
    round_N = 10.0 ** np.floor(np.log10(ARROW_LENGTH_MM / scale_mm_N))
    axes.quiverkey(drawn, 0.16, 0.06, round_N * scale_mm_N, f"{round_N:g} N", labelpos="E")


def _draw_angles(axes: Axes, cases: Sequence[CornerCase]) -> None:
    """Angle of the force against the z axis over the way of the tool."""
    for case, colour in zip(cases, _CASE_COLOURS, strict=False):
        way_mm = (
            1e3 * np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(case.position_m, axis=0), axis=1))]
        )
        angle_deg = np.degrees(np.arctan2(case.force_N[:, 0], case.force_N[:, 2]))
        angle_deg[np.linalg.norm(case.force_N, axis=1) <= 0.0] = np.nan
        axes.plot(way_mm, angle_deg, color=colour, label=case.name, lw=1.6)
    axes.set_xlabel("way of the tool, mm")
    axes.set_ylabel("force direction\nfrom vertical, deg")
    axes.legend(loc="upper left")
