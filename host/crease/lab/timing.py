"""Time for each phase of the tick: figure 9 of the paper, with and without the spheres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import CreaseError
from crease.base.native import error_text, ffi, lib, skip_mask
from crease.base.records import record
from crease.base.scene import Scene
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import Result, Setup, Table, machine, text_rows
from crease.replay.replay import ReplayOptions, make_config
from crease.replay.trajectory import Trajectory

TRIANGLES = (50, 100, 350, 800, 2700)
PHASES = ("detect", "relate", "depth", "resolve")
SPHERES = {"with spheres": skip_mask(["all"]), "without spheres": 0}

ROW = record("cr_phases_row")
"""Of host/native/phases.h."""


INPUTS = ("edge90_cube.csv", "block45k.stl", *(f"cube60_{n}.stl" for n in TRIANGLES))
"""Files of the folder of meshes."""


def time_phases(
    scene: Scene, path: Trajectory, options: ReplayOptions, repeat: int
) -> npt.NDArray[Any]:
    """Least time of each phase over `repeat` runs of each pose, structured array ROW (n,).   Errors: CreaseError."""
    out = np.zeros(len(path), dtype=ROW)
    rows = ffi.from_buffer("cr_phases_row[]", out, require_writable=True)
    poses = ffi.from_buffer("cr_path_row[]", path.rows)
    config = make_config(options)
    code = int(lib.cr_phases_run(scene.handle, config, poses, len(path), repeat, rows))
    if code != lib.CR_OK:
        raise CreaseError(f"{scene.source}: phases cannot be timed: {error_text(code)}")
    return out


def run(setup: Setup) -> Result:
    """Median over the poses in contact of every phase, for every tessellation, with and without the sphere tree."""
    result = Result(
        "timing",
        "Time of each phase",
        "The trajectory of the penetration experiment. Detect finds the samples inside, and what each "
        "piece of the tool is inside of; relate makes half-spaces of it, with their normals; depth measures how "
        "far each leads out; resolve lets all push at once, and reports. Least of "
        f"{setup.repeat} runs of each pose, median over the poses in contact. Without spheres "
        "every sample of the tool is looked up "
        f"in every tick. Machine: {machine()}.",
    )
    path = setup.path("edge90_cube")
    rows: list[tuple[object, ...]] = []
    columns: dict[str, list[float]] = {"triangles": [], "spheres": []}
    for how, skip in SPHERES.items():
        for count in TRIANGLES:
            scene = setup.scene("block45k", f"cube60_{count}", 2.0, 2.0)
            found = time_phases(scene, path, ReplayOptions(skip=skip), setup.repeat)
            touching = found[found["areas"] > 0]
            us = [1e-3 * float(np.median(touching[f"{p}_ns"])) for p in PHASES]
            total = 1e-3 * float(
                np.median(sum(touching[f"{p}_ns"].astype(np.float64) for p in PHASES))
            )
            points = float(np.median(touching["points"]))
            rows.append((how, f"{count:,}", *(f"{v:.2f}" for v in (*us, total)), f"{points:,.0f}"))
            values = [count, int(skip != 0), *us, total, points]
            names = ["triangles", "spheres", *(f"{p}_us" for p in PHASES), "total_us", "points"]
            for name, value in zip(names, values, strict=True):
                columns.setdefault(name, []).append(float(value))
    setup.write_csv(result, "timing.csv", {k: np.array(v) for k, v in columns.items()})
    heads = (
        "",
        "triangles of the tool",
        *(f"{p}, us" for p in PHASES),
        "total, us",
        "samples looked at",
    )
    result.tables.append(Table("Median time in contact", heads, text_rows(rows)))
    _draw(setup, result, columns)
    half = len(TRIANGLES)
    total_us = columns["total_us"]
    result.found.append(
        f"A tick takes {min(total_us[:half]):.1f} to {max(total_us[:half]):.1f} us whatever the "
        "tessellation; without the spheres "
        f"{min(total_us[half:]):.0f} to {max(total_us[half:]):.0f} us. Detection is most of it."
    )
    return result


def _draw(setup: Setup, result: Result, columns: dict[str, list[float]]) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(10.0, 3.9)
        axes = figure.subplots(1, 2)
        half = len(TRIANGLES)
        for axis, (k, how) in zip(axes, enumerate(SPHERES), strict=True):
            base = np.zeros(half)
            for phase, colour in zip(PHASES, COLOURS, strict=False):
                values = np.array(columns[f"{phase}_us"][k * half : (k + 1) * half])
                axis.bar(np.arange(half), values, 0.62, bottom=base, color=colour, label=phase)
                base += values
            totals = columns["total_us"][k * half : (k + 1) * half]
            for x, (y, total) in enumerate(zip(base, totals, strict=True)):
                axis.annotate(f"{total:.1f}", (x, y), ha="center", va="bottom", fontsize=8)
            axis.set_xticks(np.arange(half), [f"{n:,}" for n in TRIANGLES])
            axis.set_xlabel("triangles of the tool")
            axis.set_title(how)
            axis.grid(axis="x", visible=False)
        axes[0].set_ylabel("time of a tick in contact, us")
        handles, labels = axes[0].get_legend_handles_labels()
        axes[1].legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5))
        setup.write_figure(
            result, "timing.png", figure, "Median time of each phase; the two scales differ."
        )
