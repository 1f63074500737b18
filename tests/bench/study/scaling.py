"""Scene size: static triangles from 1k to 1M, shells from 1k to 1M samples. The cost has to follow the contact."""

from __future__ import annotations

import time

import manifold3d
import numpy as np
import numpy.typing as npt
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.attitude import to_matrix
from crease.base.scene import Scene, open_image
from crease.draw.plot import COLOURS, STYLE, new_figure
from crease.lab.setup import Result, Table, machine, make_path, text_rows
from crease.mesh.mesh import Mesh, make_mesh
from crease.replay.replay import run_path

from study.against_exact import BenchSetup

F64 = npt.NDArray[np.float64]

STATIC_REFINES = (9, 29, 91, 289)
"""A cube refined n-fold has 12 n^2 triangles: 1k, 10k, 100k, 1M."""
SHELL_SIDES_MM = (26.0, 82.0, 258.0, 816.0)
"""A cube of this side has 1k, 10k, 100k, 1M samples 2 mm apart."""
SPACINGS_MM = (3.9, 1.22, 0.39)
"""A cube of 50 mm with samples this far apart has 1k, 10k, 100k of them."""
QUICK = 2
"""Sizes that a quick look takes."""
TICKS = 400
DEPTH_MM = 2.0
HEADS = ("", "triangles", "samples", "samples inside", "looked at", "p50, us", "p99.99, us",
         "state, bytes", "image, bytes", "ticks limited", "bake, s")  # fmt: skip


def _cube(side_mm: float, refine: int = 1) -> Mesh:
    solid = manifold3d.Manifold.cube((side_mm,) * 3, True).refine(refine).to_mesh64()
    return make_mesh(
        np.asarray(solid.vert_properties)[:, :3], np.asarray(solid.tri_verts).astype(np.int64), 1e-3
    )


def _bake(static: Mesh, tool: Mesh, voxel_mm: float, spacing_mm: float) -> tuple[Scene, float]:
    start = time.perf_counter()
    options = BakeOptions(voxel_m=1e-3 * voxel_mm, spacing_m=1e-3 * spacing_mm)
    image = bake_scene(static, tool, options, lambda _label, _part: None).image
    return open_image(image, "scaling"), time.perf_counter() - start


def corner_poses(static_mm: float, tool_mm: float) -> F64:
    """The tool's lowest corner DEPTH_MM below the top of the static cube, sliding: the same contact for any size."""
    turn = np.array([np.cos(0.3), np.sin(0.3) * 0.8, np.sin(0.3) * 0.6, 0.0])
    rows = to_matrix(turn)
    up = rows[2]
    lowest = -0.5 * tool_mm * np.abs(up).sum()
    way = np.linspace(-3.0, 3.0, TICKS)
    at = np.column_stack([way, 0.3 * way, np.full(TICKS, 0.5 * static_mm - lowest - DEPTH_MM)])
    # The tool's corner, not its middle, stays over the middle of the face.
    signs = -np.sign(up)
    at[:, :2] -= rows[:2] @ (0.5 * tool_mm * signs)
    return np.hstack([1e-3 * at, np.tile(turn, (TICKS, 1))])


def _row(name: str, scene: Scene, bake_s: float, poses: F64, repeat: int) -> list[object]:
    from crease.replay.replay import World

    rows = run_path(scene, make_path(poses), repeat=repeat)
    touching = rows["areas"] > 0
    us = 1e-3 * rows["tick_ns"][touching]
    p50, p9999 = (float(np.percentile(us, q)) for q in (50, 99.99)) if len(us) else (0.0, 0.0)
    return [
        name, int(scene.meta.static_triangles), int(scene.meta.point_count),
        float(np.median(rows["contacts"])), float(np.median(rows["points"])), p50, p9999,
        World(scene).size_bytes, len(scene.image), int(np.count_nonzero(rows["overflow"])), bake_s,
    ]  # fmt: skip


def exponent(sizes: list[float], costs: list[float]) -> float:
    """Slope of log cost over log size, least squares."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def run(setup: BenchSetup) -> Result:
    """Three series, their exponents and the figure."""
    result = Result(
        "scaling",
        "Scene size",
        f"A cube's corner {DEPTH_MM:g} mm deep in the face of another cube, sliding. Static triangles: a 100 mm cube "
        "cut finer and finer. Larger tool: samples 2 mm apart on larger and larger cubes, the contact the same. Finer "
        f"shell: a 50 mm cube with more and more samples, so that more are inside. Machine: {machine()}.",
    )
    last = QUICK if setup.quick else None
    series: dict[str, list[list[object]]] = {"static triangles": [], "larger tool": [], "finer shell": []}  # fmt: skip
    for refine in STATIC_REFINES[:last]:
        scene, bake_s = _bake(_cube(100.0, refine), _cube(50.0), 2.0, 2.0)
        series["static triangles"].append(
            _row("static triangles", scene, bake_s, corner_poses(100.0, 50.0), setup.repeat)
        )
    for side in SHELL_SIDES_MM[:last]:
        scene, bake_s = _bake(_cube(100.0), _cube(side), 2.0, 2.0)
        series["larger tool"].append(
            _row("larger tool", scene, bake_s, corner_poses(100.0, side), setup.repeat)
        )
    for spacing in SPACINGS_MM[:last]:
        scene, bake_s = _bake(_cube(100.0), _cube(50.0), 2.0, spacing)
        series["finer shell"].append(
            _row("finer shell", scene, bake_s, corner_poses(100.0, 50.0), setup.repeat)
        )
    rows = [row for rows in series.values() for row in rows]
    result.tables.append(Table("Cost against size", HEADS, text_rows(_texts(rows))))
    columns = {head: np.array([row[i] for row in rows]) for i, head in enumerate(HEADS) if i}
    names = ("triangles", "samples", "inside", "looked_at", "p50_us", "p9999_us", "state_bytes",
             "image_bytes", "ticks_limited", "bake_s")  # fmt: skip
    setup.write_csv(result, "scaling.csv", dict(zip(names, columns.values(), strict=True)))
    for name, what, column in (("static triangles", "triangles", 1), ("larger tool", "samples", 2),
                               ("finer shell", "samples", 2), ("finer shell", "samples inside", 3)):  # fmt: skip
        sizes = [float(str(row[column])) for row in series[name]]
        power = exponent(sizes, [float(str(row[5])) for row in series[name]])
        result.found.append(f"{name}: time ~ ({what})^{power:.2f}")
    _draw(setup, result, series)
    return result


def _texts(rows: list[list[object]]) -> list[list[object]]:
    return [[f"{v:,}" if isinstance(v, int) else v for v in row] for row in rows]


def _draw(setup: BenchSetup, result: Result, series: dict[str, list[list[object]]]) -> None:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = new_figure(7.5, 4.6)
        axis = figure.subplots()
        for (name, rows), colour in zip(series.items(), COLOURS, strict=False):
            column = 1 if name == "static triangles" else 2
            sizes = [float(str(row[column])) for row in rows]
            axis.plot(sizes, [float(str(row[5])) for row in rows], "o-", color=colour, label=name)
        span = np.array([1e3, 1e6])
        axis.plot(span, 2.0 * span / span[0], ":", color="#888888", label="proportional to size")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_ylim(1.0, 300.0)
        axis.set_xlabel("static triangles, or samples of the tool")
        axis.set_ylabel("time of a tick in contact, us (median)")
        axis.legend()
        axis.set_title("The cost follows the contact, not the scene")
        setup.write_figure(result, "scaling.png", figure, "Median time of a tick against size.")
