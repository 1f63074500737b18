"""Long thin tools: how many points the spheres leave to examine (figure 5 of the paper)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.native import skip_mask
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import F64, MM, Result, Setup, Table, make_path, text_rows
from crease.replay.replay import ReplayOptions, run_path

DEPTH_MM, TICKS = 1.0, 600
TOOLS = {
    "screwdriver": ("screwdriver", 3.0, (25.0, 95.0)),
    "spanner": ("spanner", 4.0, (-25.0, 25.0)),
}
"""Mesh; half thickness in mm where the tool lies on the edge; where along it, in mm from its origin."""

SKIPS = {"with spheres": skip_mask(["all"]), "without spheres": 0}


INPUTS = ("block45k.stl", *(f"{mesh}.stl" for mesh, *_ in TOOLS.values()))
"""Files of the folder of meshes."""


def edge_path(half_mm: float, along_mm: tuple[float, float], ticks: int) -> F64:
    """Poses (n, 7) of a tool, its length along x, that lies across the block's edge (the y axis), slides and tips."""
    s = np.linspace(0.0, 1.0, ticks)
    pitch = np.radians(20.0 + 40.0 * s)
    along = along_mm[0] + (along_mm[1] - along_mm[0]) * s
    # The tool's x axis falls outwards; its middle line passes half its thickness, less the depth, above the edge.
    way = np.column_stack([np.cos(pitch), np.zeros(ticks), -np.sin(pitch)])
    up = np.column_stack([np.sin(pitch), np.zeros(ticks), np.cos(pitch)])
    start = up * (half_mm + 3.0 - (3.0 + DEPTH_MM) * np.clip(6.0 * s, 0.0, 1.0))[:, None]
    position = (start - way * along[:, None]) * MM
    turn = np.column_stack([np.cos(pitch / 2), np.zeros(ticks), np.sin(pitch / 2), np.zeros(ticks)])
    return np.hstack([position, turn])


def run(setup: Setup) -> Result:
    """Points and spheres looked at per tick, with and without the sphere tree."""
    result = Result(
        "slender",
        "Long thin tools",
        f"A screwdriver (its shaft) and a spanner lie across the edge of the block, {DEPTH_MM:g} "
        "mm deep, and slide and tip over it. "
        "Without spheres every sample is looked up in every tick. With them, only the spheres "
        "near the edge are opened.",
    )
    rows: list[tuple[object, ...]] = []
    columns: dict[str, npt.NDArray[Any]] = {"tick": np.arange(0, TICKS, setup.every)}
    for label, (mesh, half_mm, along_mm) in TOOLS.items():
        path = make_path(setup.thinned(edge_path(half_mm, along_mm, TICKS)))
        scene = setup.scene("block45k", mesh, 2.0, 1.2)
        for how, skip in SKIPS.items():
            found = run_path(scene, path, ReplayOptions(skip=skip), repeat=setup.repeat)
            touching = found["areas"] > 0
            setup.check_left(bool(touching.any()), "no pose in contact")
            median = {
                k: float(np.median(found[k][touching]))
                for k in ("points", "nodes", "contacts", "tick_ns")
            }
            columns |= {
                f"{label}_{how.replace(' ', '_')}_{k}": found[k]
                for k in ("points", "nodes", "contacts")
            }
            rows.append((label, how, f"{median['points']:,.0f}", f"{median['nodes']:,.0f}",
                         f"{median['contacts']:,.0f}", f"{1e-3 * median['tick_ns']:.1f}"))  # fmt: skip
    setup.write_csv(result, "slender.csv", columns)
    heads = ("tool", "", "samples looked at", "spheres looked at", "samples inside", "tick, us")
    result.tables.append(Table("Median of the ticks in contact", heads, text_rows(rows)))
    _draw(setup, result, columns)
    less = [
        float(np.median(columns[f"{t}_without_spheres_points"]))
        / max(1.0, float(np.median(columns[f"{t}_with_spheres_points"])))
        for t in TOOLS
    ]
    result.found.append(
        f"The spheres leave {' and '.join(f'1/{v:.0f}' for v in less)} of the samples of "
        f"{' and '.join(TOOLS)} to look at."
    )
    return result


def _draw(setup: Setup, result: Result, columns: dict[str, npt.NDArray[Any]]) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(10.0, 3.6)
        for axis, tool in zip(figure.subplots(1, 2, sharey=True), TOOLS, strict=True):
            curves = {
                "looked at without spheres": (f"{tool}_without_spheres_points", COLOURS[1]),
                "looked at with spheres": (f"{tool}_with_spheres_points", COLOURS[0]),
                "inside": (f"{tool}_with_spheres_contacts", COLOURS[2]),
            }
            for label, (name, colour) in curves.items():
                axis.plot(
                    columns["tick"], np.maximum(columns[name], 0.5), color=colour, label=label
                )
            axis.set_yscale("log")
            axis.set_title(tool)
            axis.set_xlabel("tick")
            axis.set_ylim(0.8, None)
        figure.axes[0].set_ylabel("samples")
        figure.axes[0].legend(loc="center right", bbox_to_anchor=(1.0, 0.72))
        setup.write_figure(result, "slender.png", figure, "Samples looked at in each tick.")
