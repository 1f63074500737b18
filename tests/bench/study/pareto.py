"""Run time against error: voxel, spacing, tessellation, coverage, response, rivals, and the exact floor."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from crease.base.scene import Scene
from crease.lab.exact import exact_contact, make_solids
from crease.lab.setup import Result, Table, machine, text_rows
from crease.replay.measures import DEEP_M, angle_deg
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory

from study.against_exact import BenchSetup, Exact, exact_force_N, measure
from study.cost import cost_of, instructions
from study.pareto_figure import draw
from study.points import OURS, ZONES, Point, read_points, verdict, write_records
from study.sweeps import MAIN, SWEEPS, Sweep

POINTS_CSV = "pareto.csv"
FLOOR_MM = 1e-6
"""The exact tables are rounded to this: the floor of the figure."""

EXACT_POSES = 20
SILENT_MAX = 0.01
"""A response that is silent in more than this share of deep contact has no direction error to speak of."""


@dataclass(frozen=True)
class Case:
    """One of our ways to answer one path."""

    sweep: Sweep
    group: str
    label: str
    scene: Scene
    options: ReplayOptions


def cases_of(setup: BenchSetup, sweep: Sweep) -> list[Case]:
    """What is measured on a path. Baking is what takes long: a quick look leaves out all that needs other images."""
    soft = ReplayOptions()
    base = setup.scene(sweep.static, sweep.tool, *sweep.base_mm)
    cases = [Case(sweep, OURS, "way out", base, soft)]
    extent = ReplayOptions(response="extent")
    cases.append(Case(sweep, ZONES, "extent", base, extent))
    cases.append(Case(sweep, ZONES, "published", base, replace(extent, coverage="hard")))
    cases += [
        Case(sweep, "rival response", n, base, ReplayOptions(response=n)) for n in sweep.rivals
    ]
    if setup.quick:
        return cases
    for tool in sweep.tessellations:
        scene = setup.scene(sweep.static, tool, *sweep.base_mm)
        cases.append(
            Case(
                sweep, "tessellation", f"{int(scene.meta.tool_triangles):,} triangles", scene, soft
            )
        )
    for voxel in sweep.voxels_mm:
        scene = setup.scene(sweep.static, sweep.tool, voxel, sweep.base_mm[1])
        cases.append(Case(sweep, "voxel size", f"{voxel:g} mm voxel", scene, soft))
    for spacing in sweep.spacings_mm:
        scene = setup.scene(sweep.static, sweep.tool, sweep.base_mm[0], spacing)
        cases.append(Case(sweep, "sample spacing", f"{spacing:g} mm samples", scene, soft))
    return cases


def _point(setup: BenchSetup, case: Case, path: Trajectory) -> Point:
    """Time and error of a case; its instructions are counted later."""
    exact = setup.exact_of(case.sweep.path, case.options)
    cost = cost_of(case.scene, path, case.options, setup.repeat)
    found = measure(case.scene, path, exact, case.options)
    median_deg, silent = _directions(case.scene, path, exact, case.options)
    p99_deg = math.nan if silent > SILENT_MAX else found.direction_p99_deg
    meta = case.scene.meta
    return Point(
        case.sweep.path, case.group, case.label, 1e3 * float(meta.voxel_m), 1e3 * float(meta.spacing_m),
        int(meta.tool_triangles), cost.p50_us, cost.p9999_us, math.nan, cost.state_bytes, cost.image_bytes,
        found.force_rms_mm, found.force_max_mm, median_deg, p99_deg, found.depth_rms_mm, found.amplification,
        found.amplification_exact,
    )  # fmt: skip


def _directions(
    scene: Scene, path: Trajectory, exact: Exact | None, options: ReplayOptions
) -> tuple[float, float]:
    """Median direction error, NaN when silent or nothing exact is known; share of the deep ticks without a force."""
    if exact is None:
        return math.nan, 0.0
    force = run_path(scene, path, options)["force_N"].astype(np.float64)
    true = exact_force_N(exact, options.stiffness_N_m)
    deep = np.linalg.norm(true, axis=1) > options.stiffness_N_m * DEEP_M
    silent = 1.0 - float(force[deep].any(axis=1).mean())
    turn = angle_deg(force, true)[deep]
    return (math.nan if silent > SILENT_MAX else float(np.median(turn))), silent


def _sweep(setup: BenchSetup, sweep: Sweep) -> list[Point]:
    path = setup.path(sweep.path)
    cases = cases_of(setup, sweep)
    points = [_point(setup, case, path) for case in cases]
    if not setup.quick:
        counts = instructions([(case.scene, path, case.options) for case in cases])
        points = [replace(p, instructions=count) for p, count in zip(points, counts, strict=True)]
    exact = setup.exact_of(sweep.path, ReplayOptions(response="extent"))
    return [*points, *([_exact_point(setup, sweep, path, exact)] if exact else [])]


def _exact_point(setup: BenchSetup, sweep: Sweep, path: Trajectory, exact: Exact) -> Point:
    """The extent of the overlap from a boolean of the two meshes: no error but the table's rounding, and its time."""
    solids = make_solids(setup.mesh(sweep.static), setup.mesh(sweep.tool))
    deep = np.flatnonzero(exact["depth_mm"] > 0)
    times = []
    for i in deep[np.linspace(0, len(deep) - 1, EXACT_POSES).astype(int)]:
        tries = []
        for _ in range(3):
            start = time.perf_counter()
            exact_contact(solids, path.rows[i, 1:8])
            tries.append(1e6 * (time.perf_counter() - start))
        times.append(min(tries))
    nan = math.nan
    return Point(sweep.path, "exact boolean", "exact boolean", nan, nan, 0,
                 float(np.median(times)), max(times), nan, 0, 0,
                 FLOOR_MM, FLOOR_MM, 1e-4, 1e-4, FLOOR_MM, nan, nan)  # fmt: skip


def run(setup: BenchSetup) -> Result:
    """All sweeps, the figures, the table and the verdict."""
    result = Result(
        "pareto",
        "Run time against error",
        "Time of a tick (libraries: of a query) against its error over recorded paths: from the exact way out; extent, "
        "published and fixed45 from the exact extent, which they stand for. Time is the least of "
        f"{setup.repeat} runs of each pose, median over the poses in contact. Machine: {machine()}.",
    )
    peers = read_points(setup.peers) if setup.peers else []
    points = [p for sweep in SWEEPS for p in _sweep(setup, sweep)] + peers
    write_records(setup.out / POINTS_CSV, points)
    result.files.append(POINTS_CSV)
    keys = ("scene", "label", "p50_us", "p9999_us", "instructions", "image_bytes", "force_rms_mm",
            "direction_p50_deg", "direction_p99_deg", "amplification", "amplification_exact")  # fmt: skip
    heads = ("path", "", "p50, us", "p99.99, us", "instructions", "image, bytes", "force RMS, mm",
             "direction p50, deg", "p99, deg", "amplification", "exact")  # fmt: skip
    rows = [[_text(getattr(p, k)) for k in keys] for p in points]
    result.tables.append(Table("Each way to answer", heads, text_rows(rows)))
    result.found += [
        "Where a rival is both faster and more accurate than the default:",
        *verdict(points),
    ]
    caption = "Each mark is one way to answer the path; the exact boolean has no error and stands on the floor."
    for name, sweeps in (("pareto.png", SWEEPS[:MAIN]), ("pareto_more.png", SWEEPS[MAIN:])):
        setup.write_figure(result, name, draw(points, sweeps), caption)
    return result


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
    return f"{value:,}" if isinstance(value, int) else str(value)
