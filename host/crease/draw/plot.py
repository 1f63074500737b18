"""Figures of tables of ticks: force, torque, depth, change of direction, cost."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Table = Mapping[str, npt.NDArray[Any]]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#555555", "#000000")
"""Told apart by colour-blind readers too (Okabe, Ito)."""


FORCE_FLOOR_N = 1e-3
"""Below this a force has no direction worth plotting."""

NOTICEABLE_TURN_DEG = 18.0
"""Published threshold above which a change of direction is felt."""

HELD = "couple_N_m"
"""A column of a held tool's table only: its depth is how far the spring is drawn."""

FEW = 20
"""Points of a line, at most, that are marked: a line through one point does not show."""

FORCE_SPAN_N, TORQUE_SPAN_NM, LENGTH_SPAN_MM, TURN_SPAN_DEG = 0.05, 1e-3, 0.05, 0.1
"""Least heights of axes: what is felt by nobody, rounding above all, is not drawn as if it filled the panel."""

DECADES = 10.0
"""A largest turn so many times all but a hundredth of the others has an axis of decades: the others show too."""

TURN_FLOOR_DEG = 0.01
"""Where that begins."""

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.dpi": 100.0,
    "savefig.dpi": 150.0,
    "svg.hashsalt": "crease",
}


def forces_N(table: Table) -> npt.NDArray[np.float64]:
    """Force of every tick, (n, 3)."""
    return np.stack([np.asarray(table[f"f{axis}_N"], dtype=np.float64) for axis in "xyz"], axis=1)


def torques_Nm(table: Table) -> npt.NDArray[np.float64]:
    """Torque about the tool origin of every tick, (n, 3)."""
    return np.stack([np.asarray(table[f"t{axis}_Nm"], dtype=np.float64) for axis in "xyz"], axis=1)


def turn_deg(force_N: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Angle between the forces of neighbouring ticks, (n,); NaN at the first tick and where either has none."""
    size = np.linalg.norm(force_N, axis=1)
    turn = np.full(len(force_N), np.nan)
    both = (size[1:] > FORCE_FLOOR_N) & (size[:-1] > FORCE_FLOOR_N)
    before, after = force_N[:-1][both], force_N[1:][both]
    across = np.linalg.norm(np.cross(before, after), axis=1)
    turn[1:][both] = np.degrees(np.arctan2(across, np.einsum("ij,ij->i", before, after)))
    return turn


def new_figure(width: float, height: float) -> Figure:
    """An empty figure in the style of the house, in inches. No window, no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def plain(text: str) -> str:
    """A name or a title as it stands, whatever it has of mathematics: `$` begins none. What is no UTF-8 is a mark."""
    text = text.encode(errors="surrogateescape").decode(errors="replace")
    return text.replace("$", r"\$")


@contextmanager
def quiet_glyphs() -> Iterator[None]:
    """Within this nothing is said of letters that the font has not: they are drawn as boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from", UserWarning)
        yield


def mark_few(panels: Sequence[Axes]) -> None:
    """Marks on lines of few points that have none."""
    for line in (line for axes in panels for line in axes.lines):
        of_data = line.axes is not None and line.get_transform() == line.axes.transData
        few = len(np.atleast_1d(line.get_xdata())) <= FEW
        if of_data and few and line.get_marker() == "None":
            line.set(marker="o", markersize=3.0)


def save_figure(figure: Figure, file: IO[bytes], kind: str) -> None:
    """Write a figure as `png`, `svg` or `pdf`; the same bytes for the same figure."""
    import matplotlib as mpl

    # Dates in the file would make each run differ.
    dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}
    with mpl.rc_context(STYLE), quiet_glyphs():
        figure.savefig(file, format=kind, metadata=dated[kind])


def draw_ticks(tables: Sequence[Table], names: Sequence[str], title: str | None = None) -> Figure:
    """Panels over time: force, torque, depth, direction change per tick, cost of a tick; one colour for each table.

    Of the force |F|, and each component in a panel of its own; turns that span decades have a logarithmic axis.

    Shapes: each table has the columns of `crease.replay.replay.ANSWER_COLUMNS`, of its own length; without those of the
    torque in any of them that panel is left out.
    """
    import matplotlib as mpl

    with_torque = all("tx_Nm" in table for table in tables)
    heights = [1.5, 1.0, 1.0, 1.0]
    heights += [1.3] * (3 + with_torque)
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 1.4 * sum(heights) + 1.2)
        panels = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        _draw_magnitudes(panels.pop(0), tables, names)
        _draw_components([panels.pop(0) for _ in "xyz"], tables)
        if with_torque:
            _draw_torque(panels.pop(0), tables)
        _draw_depth(panels[0], tables)
        _draw_turn(panels[1], tables)
        _draw_cost(panels[2], tables)
        panels[2].set_xlabel("time, s")
        panels[2].margins(x=0.01)
        figure.align_ylabels()
        mark_few(figure.axes)
        alone = names[0] if len(names) == 1 else ""  # the legend names several
        figure.suptitle(plain(title or alone), fontsize=11, fontweight="bold", wrap=True)
    return figure


def at_least(axes: Axes, span: float) -> None:
    """No less than `span` from bottom to top: around the middle, or up from a bottom at zero."""
    low, high = axes.get_ylim()
    if high - low < span:
        below = 0.0 if low == 0.0 else 0.5
        middle = low + below * (high - low)
        axes.set_ylim(middle - below * span, middle + (1.0 - below) * span)


def legend_beside(axes: Axes, handles: list[Any] | None = None) -> None:
    """The legend beside the panel, where it hides nothing."""
    options: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
    if handles is not None:
        options["handles"] = handles
    axes.legend(**options)


def _pens(tables: Sequence[Table]) -> list[tuple[Table, dict[str, Any]]]:
    """Colour and width of each table's lines. The first is the widest: it shows under others that agree with it."""
    widths = [1.2] if len(tables) == 1 else [2.2, *[1.1] * (len(tables) - 1)]
    return [
        (table, {"color": colour, "lw": width})
        for table, colour, width in zip(tables, COLOURS, widths, strict=False)
    ]


def _draw_magnitudes(axes: Axes, tables: Sequence[Table], names: Sequence[str]) -> None:
    for (table, pen), name in zip(_pens(tables), names, strict=True):
        axes.plot(table["t_s"], np.linalg.norm(forces_N(table), axis=1), label=plain(name), **pen)
    axes.set_ylabel("|F|, N")
    at_least(axes, FORCE_SPAN_N)
    if len(tables) > 1:
        legend_beside(axes)


def _draw_components(panels: Sequence[Axes], tables: Sequence[Table]) -> None:
    """A panel for each of x, y, z, all to one scale."""
    for table, pen in _pens(tables):
        for axes, force_N in zip(panels, forces_N(table).T, strict=True):
            axes.plot(table["t_s"], force_N, **pen)
    told = np.concatenate([forces_N(table).ravel() for table in tables])
    told = told[np.isfinite(told)]
    low, high = (float(told.min()), float(told.max())) if len(told) else (0.0, 0.0)
    margin = max(0.05 * (high - low), 0.1 * FORCE_SPAN_N)
    for axes, name in zip(panels, "xyz", strict=True):
        axes.set_ylabel(f"F{name}, N")
        axes.set_ylim(low - margin, high + margin)
        at_least(axes, FORCE_SPAN_N)


def _draw_torque(axes: Axes, tables: Sequence[Table]) -> None:
    for table, pen in _pens(tables):
        axes.plot(table["t_s"], np.linalg.norm(torques_Nm(table), axis=1), **pen)
    axes.set_ylabel("|torque|, N m")
    axes.set_ylim(bottom=0.0)
    at_least(axes, TORQUE_SPAN_NM)


def _draw_depth(axes: Axes, tables: Sequence[Table]) -> None:
    for table, pen in _pens(tables):
        axes.plot(table["t_s"], 1e3 * np.asarray(table["depth_m"]), **pen)
    held = [HELD in table for table in tables]
    of_one_kind = "hand from the\nheld tool, mm" if all(held) else "depth, mm"
    mixed = any(held) and not all(held)
    axes.set_ylabel("depth, or hand from\nthe held tool, mm" if mixed else of_one_kind)
    axes.set_ylim(bottom=0.0)
    at_least(axes, LENGTH_SPAN_MM)


def _draw_turn(axes: Axes, tables: Sequence[Table]) -> None:
    turns = [turn_deg(forces_N(table)) for table in tables]
    for turn, (table, pen) in zip(turns, _pens(tables), strict=True):
        axes.plot(table["t_s"], turn, **pen)
    told = [turn[np.isfinite(turn)] for turn in turns]
    largest = max((float(turn.max()) for turn in told if len(turn)), default=0.0)
    noticeable = largest > 0.5 * NOTICEABLE_TURN_DEG
    top = max(largest, NOTICEABLE_TURN_DEG * noticeable)
    usual = min((float(np.percentile(turn, 99)) for turn in told if len(turn)), default=0.0)
    if largest > 1.0 and largest > DECADES * usual:
        axes.set_yscale("log")
        axes.set_ylim(TURN_FLOOR_DEG, 3.0 * top)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    else:
        axes.set_ylim(
            0.0, max(1.1 * largest, 1.3 * NOTICEABLE_TURN_DEG * noticeable, TURN_SPAN_DEG)
        )
    if noticeable:
        axes.axhline(NOTICEABLE_TURN_DEG, color="#999999", lw=0.8, ls=(0, (4, 3)))
        axes.annotate(
            "noticeable",
            (0.005, NOTICEABLE_TURN_DEG),
            xycoords=("axes fraction", "data"),
            xytext=(0, 2),
            textcoords="offset points",
            color="#777777",
            fontsize=7.5,
        )
    axes.set_ylabel("direction change,\ndeg per tick")


def _draw_cost(axes: Axes, tables: Sequence[Table]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    for table, pen in _pens(tables):
        cost_us = np.maximum(np.asarray(table["tick_ns"], dtype=np.float64), 1.0) * 1e-3
        axes.plot(table["t_s"], cost_us, color=pen["color"], lw=0.7, alpha=0.8)
    axes.set_yscale("log")
    axes.set_ylabel("tick cost, us")
    axes.yaxis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
