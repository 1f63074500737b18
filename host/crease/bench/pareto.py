"""Run time against error: voxel, spacing, tessellation, coverage, response, rivals, and the exact floor."""

from __future__ import annotations

import csv
import io
import math
import time
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crease.bench.cost import cost_of, counter, instructions
from crease.bench.setup import BenchSetup, Exact, exact_force_N, measure
from crease.errors import CreaseError
from crease.exact import exact_contact, make_solids
from crease.experiment.setup import Result, Table, machine, text_rows
from crease.measures import DEEP_M, angle_deg
from crease.native import RESPONSES
from crease.plot import COLOURS, STYLE, new_figure
from crease.replay import ReplayOptions, run_path
from crease.scene import Scene
from crease.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS_CSV = "pareto.csv"
FLOOR_MM = 1e-6
"""The exact tables are rounded to this: the floor of the figure."""

EXACT_POSES = 20
SILENT_MAX = 0.01
"""A response that is silent in more than this share of deep contact has no direction error to speak of."""


@dataclass(frozen=True)
class Point:
    """One way to answer one path. Times in us, errors in mm and degrees; NaN where it has none."""

    scene: str
    group: str
    label: str
    voxel_mm: float
    spacing_mm: float
    tool_triangles: int
    p50_us: float
    p9999_us: float
    instructions: float
    state_bytes: int
    image_bytes: int
    force_rms_mm: float
    force_max_mm: float
    direction_p50_deg: float
    direction_p99_deg: float
    depth_rms_mm: float
    amplification: float
    amplification_exact: float


@dataclass(frozen=True)
class Sweep:
    """A path, its two meshes, the sizes it is baked with by default, and what is swept."""

    path: str
    static: str
    tool: str
    base_mm: tuple[float, float]
    voxels_mm: tuple[float, ...]
    spacings_mm: tuple[float, ...]
    tessellations: tuple[str, ...]


SWEEPS = (
    Sweep("edge90_cube", "block45k", "cube60_2700", (2.0, 2.0), (1.0, 4.0, 8.0), (1.0, 4.0, 8.0),
          ("cube60_50", "cube60_350")),
    Sweep("edge90_sphere", "block45k", "sphere50", (2.0, 3.9), (8.0,), (2.0, 8.0), ()),
)  # fmt: skip

GROUPS = {
    "zones, default": ("*", COLOURS[1], 190),
    "voxel size": ("s", COLOURS[0], 42),
    "sample spacing": ("o", COLOURS[2], 42),
    "tessellation": ("^", COLOURS[5], 46),
    "hard coverage": ("P", COLOURS[6], 60),
    "rival response": ("D", COLOURS[3], 46),
    "rival library": ("X", COLOURS[7], 62),
    "exact boolean": ("h", COLOURS[4], 80),
}
"""Marker, colour and size of each group."""

COLUMNS = tuple(f.name for f in fields(Point))


def _point(setup: BenchSetup, program: Path | None, sweep: Sweep, group: str, label: str,
           scene: Scene, path: Trajectory, exact: Exact, options: ReplayOptions) -> Point:  # fmt: skip
    cost = cost_of(scene, path, options, setup.repeat)
    found = measure(scene, path, exact, options)
    median_deg, silent = _directions(scene, path, exact, options)
    p99_deg = math.nan if silent > SILENT_MAX else found.direction_p99_deg
    meta = scene.meta
    return Point(
        sweep.path, group, label, 1e3 * float(meta.voxel_m), 1e3 * float(meta.spacing_m),
        int(meta.tool_triangles), cost.p50_us, cost.p9999_us,
        instructions(program, scene, path, options), cost.state_bytes, cost.image_bytes,
        found.force_rms_mm, found.force_max_mm, median_deg, p99_deg, found.depth_rms_mm,
        found.amplification,
        found.amplification_exact,
    )  # fmt: skip


def _directions(
    scene: Scene, path: Trajectory, exact: Exact, options: ReplayOptions
) -> tuple[float, float]:
    """Median direction error, NaN when it is silent; share of the deep ticks without a force."""
    force = run_path(scene, path, options)["force_N"].astype(np.float64)
    true = exact_force_N(exact, options.stiffness_N_m)
    deep = np.linalg.norm(true, axis=1) > options.stiffness_N_m * DEEP_M
    silent = 1.0 - float(force[deep].any(axis=1).mean())
    turn = angle_deg(force, true)[deep]
    return (math.nan if silent > SILENT_MAX else float(np.median(turn))), silent


def _sweep(setup: BenchSetup, program: Path | None, sweep: Sweep) -> list[Point]:
    path, exact = setup.path(sweep.path), setup.exact_of(sweep.path)

    def point(group: str, label: str, scene: Scene, options: ReplayOptions) -> Point:
        return _point(setup, program, sweep, group, label, scene, path, exact, options)

    soft = ReplayOptions()
    base = setup.scene(sweep.static, sweep.tool, *sweep.base_mm)
    points = [point("zones, default", "zones", base, soft)]
    points.append(point("hard coverage", "hard", base, ReplayOptions(coverage="hard")))
    rivals = [
        n for n in RESPONSES if n != "zones" and (n != "sphere_proxy" or "sphere" in sweep.path)
    ]
    points += [point("rival response", n, base, ReplayOptions(response=n)) for n in rivals]
    # Baking is what takes long: a quick look leaves these out.
    for tool in () if setup.quick else sweep.tessellations:
        scene = setup.scene(sweep.static, tool, *sweep.base_mm)
        count = f"{int(scene.meta.tool_triangles):,} triangles"
        points.append(point("tessellation", count, scene, soft))
    for voxel in () if setup.quick else sweep.voxels_mm:
        scene = setup.scene(sweep.static, sweep.tool, voxel, sweep.base_mm[1])
        points.append(point("voxel size", f"{voxel:g} mm voxel", scene, soft))
    for spacing in () if setup.quick else sweep.spacings_mm:
        scene = setup.scene(sweep.static, sweep.tool, sweep.base_mm[0], spacing)
        points.append(point("sample spacing", f"{spacing:g} mm samples", scene, soft))
    return [*points, _exact_point(setup, sweep, path, exact)]


def _exact_point(setup: BenchSetup, sweep: Sweep, path: Trajectory, exact: Exact) -> Point:
    """The boolean of the two meshes: no error but the table's rounding, and its time."""
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


def read_points(file: Path) -> list[Point]:
    """Points of rival libraries, as `make bench-peers` writes them.   Errors: CreaseError."""
    try:
        with file.open(encoding="utf-8", newline="") as source:
            return [
                Point(**{f.name: _parse(f.type, row[f.name]) for f in fields(Point)})
                for row in csv.DictReader(source)
            ]
    except (OSError, KeyError, ValueError) as error:
        raise CreaseError(
            f"{file}: cannot be read as points of rival libraries: {error}"
        ) from error


def _parse(kind: Any, text: str) -> Any:
    parsers: dict[str, Any] = {"str": str, "int": int, "float": float}
    return parsers[str(kind)](text)


def write_points(file: Path, points: list[Point]) -> None:
    """All points as CSV.   Errors: CreaseError."""
    from crease.table import write_bytes

    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for p in points:
        values = (getattr(p, name) for name in COLUMNS)
        out.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])
    write_bytes(file, text.getvalue().encode())


def float32_um(scene: Scene, path: Trajectory) -> float:
    """RMS change of the force over stiffness, in um, when every number of the pose moves by one step of float32.

    What single precision can cost at these lengths: the tick's own rounding acts like that of its inputs.
    """
    rows = path.rows.copy()
    sign = np.random.default_rng(1).choice([-1.0, 1.0], rows[:, 1:8].shape)
    single = rows[:, 1:8].astype(np.float32)
    rows[:, 1:8] = np.where(
        sign > 0, np.nextafter(single, np.float32(2)), np.nextafter(single, np.float32(-2))
    )
    moved = run_path(scene, Trajectory(rows, path.source))["force_N"].astype(np.float64)
    still = run_path(scene, path)["force_N"].astype(np.float64)
    gone = np.linalg.norm(moved - still, axis=1) / ReplayOptions().stiffness_N_m
    return 1e6 * float(np.sqrt((gone**2).mean()))


def dominated(points: list[Point]) -> list[str]:
    """Rivals that are both faster and more accurate (force RMS, or 99th percentile of direction) than the default."""
    found = []
    for name in dict.fromkeys(p.scene for p in points):
        here = [p for p in points if p.scene == name]
        ours = next(p for p in here if p.group == "zones, default")
        for p in here:
            if not p.group.startswith("rival") or p.p50_us >= ours.p50_us:
                continue
            better = [
                what
                for what, key in (("force", "force_rms_mm"), ("direction", "direction_p99_deg"))
                if getattr(p, key) < getattr(ours, key)
            ]
            if better:
                found.append(
                    f"{name}: {p.label} is faster and has less error of {' and '.join(better)}"
                )
    return found


def run(setup: BenchSetup) -> Result:
    """All sweeps, the figure and the table."""
    result = Result(
        "pareto",
        "Run time against error",
        "Time of a tick (rivals: of a query) against its error over two recorded paths round a right-angled edge. Time "
        f"is the least of {setup.repeat} runs of each pose, median over the poses in contact. Machine: {machine()}.",
    )
    program = None if setup.quick else counter(setup.out)
    points = [p for sweep in SWEEPS for p in _sweep(setup, program, sweep)]
    if program is not None:
        program.unlink()
    points += read_points(setup.peers) if setup.peers else []
    write_points(setup.out / POINTS_CSV, points)
    result.files.append(POINTS_CSV)
    keys = ("scene", "label", "p50_us", "p9999_us", "instructions", "image_bytes", "force_rms_mm",
            "direction_p50_deg", "direction_p99_deg", "amplification", "amplification_exact")  # fmt: skip
    heads = ("path", "", "p50, us", "p99.99, us", "instructions", "image, bytes", "force RMS, mm",
             "direction p50, deg", "p99, deg", "amplification", "exact")  # fmt: skip
    rows = [[_text(getattr(p, k)) for k in keys] for p in points]
    result.tables.append(Table("Each way to answer", heads, text_rows(rows)))
    for sweep in SWEEPS:
        scene = setup.scene(sweep.static, sweep.tool, *sweep.base_mm)
        um = float32_um(scene, setup.path(sweep.path))
        result.found.append(
            f"{sweep.path}: one step of float32 in every number of the pose changes the force by {um:.2g} um RMS "
            "(over stiffness); the exact tables are computed in double."
        )
    worse = dominated(points)
    result.found += worse or [
        "No rival measured here is both faster and more accurate than the default."
    ]
    _draw(setup, result, points)
    return result


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
    return f"{value:,}" if isinstance(value, int) else str(value)


def _limits(points: list[Point], key: str) -> tuple[float, float]:
    """Both ends of a log axis that holds every point but the exact ones, with room."""
    values = [getattr(p, key) for p in points if p.group != "exact boolean"]
    values = [v for v in values if v > 0]
    return 0.35 * min(values), 3.0 * max(values)


def _draw(setup: BenchSetup, result: Result, points: list[Point]) -> None:
    import matplotlib as mpl

    keys = {
        "force_rms_mm": "force error, mm RMS (|F - F*| / k)",
        "direction_p99_deg": "direction error, deg (99th percentile)",
    }
    with mpl.rc_context(STYLE):
        figure = new_figure(13.0, 9.4)
        axes = figure.subplots(2, 2, sharex=True, sharey="row")
        times = [p.p50_us for p in points]
        x_range = 0.5 * min(times), 9.0 * max(times)
        for row, (key, label) in enumerate(keys.items()):
            axes[row, 0].set_ylabel(label)
            for column, sweep in enumerate(SWEEPS):
                here = [p for p in points if p.scene == sweep.path]
                _panel(axes[row, column], here, key, x_range, _limits(points, key))
        for column, sweep in enumerate(SWEEPS):
            axes[0, column].set_title(f"{sweep.path}: {sweep.tool} over the edge of {sweep.static}")
            axes[1, column].set_xlabel("time of a tick in contact, us (median; rivals: of a query)")
        handles = [
            axes[0, 0].scatter([], [], marker=m, color=c, s=s, label=name)
            for name, (m, c, s) in GROUPS.items()
            if any(p.group == name for p in points)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
        figure.suptitle(
            f"Run time against error: down and left is better ({machine()})", fontsize=11
        )
        caption = "Each mark is one way to answer the path; the exact boolean has no error and stands on the floor."
        setup.write_figure(result, "pareto.png", figure, caption)


def _panel(axis: Axes, points: list[Point], key: str, x_range: tuple[float, float],
           y_range: tuple[float, float]) -> None:  # fmt: skip
    """One panel: marks, the exact boolean on the floor, and labels that do not cover each other."""
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(*x_range)
    axis.set_ylim(*y_range)
    marks = []
    for p in points:
        value = y_range[0] if p.group == "exact boolean" else getattr(p, key)
        if not value > 0:
            continue
        marker, colour, size = GROUPS[p.group]
        axis.scatter(
            p.p50_us, value, marker=marker, color=colour, s=size, zorder=3, lw=0, clip_on=False
        )
        marks.append((p.p50_us, value, p.label, colour))
    _spread_labels(axis, marks, x_range, y_range)


def _spread_labels(axis: Axes, marks: list[tuple[float, float, str, str]], x_range: tuple[float, float],
                   y_range: tuple[float, float]) -> None:  # fmt: skip
    """Labels to the right of their marks, moved up until they are clear of other labels and marks.

    Worked out in shares of the axes, from the size of a letter on this figure.
    """

    def share(value: float, ends: tuple[float, float]) -> float:
        return math.log(value / ends[0]) / math.log(ends[1] / ends[0])

    places = [(share(x, x_range), share(y, y_range)) for x, y, _, _ in marks]
    taken = [(x - 0.009, x + 0.009, y - 0.012, y + 0.012) for x, y in places]
    height = 0.03
    for i in sorted(range(len(marks)), key=lambda k: places[k][1]):
        _, _, text, colour = marks[i]
        x, y = places[i]
        left, middle = x + 0.015, max(y, 0.03)
        right = left + 0.0105 * len(text)
        while any(left < b and a < right and middle - height / 2 < d and c < middle + height / 2
                  for a, b, c, d in taken):  # fmt: skip
            middle += 0.25 * height
        taken.append((left, right, middle - height / 2, middle + height / 2))
        line = {"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 0, "shrinkB": 2}
        axis.annotate(text, (x, y), (left, middle), xycoords="axes fraction", textcoords="axes fraction",
                      fontsize=7.5, color=colour, va="center",
                      arrowprops=line if middle - y > 0.6 * height and y > 0 else None)  # fmt: skip
