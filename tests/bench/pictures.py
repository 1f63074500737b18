"""The pictures of firmware/contact/DESIGN.md, from replays of the test scenes and from tests/bench/pareto.csv.

    python tests/bench/pictures.py [-o FOLDER]      # make pictures: firmware/contact, 5 s; needs build/scenes

The same files on every run, up to the last bits of a bake on another processor.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from bench import EXACT, MESHES, ROOT, SCENES
from crease.bake.distance_errors import look_up
from crease.bake.scene_list import load_specs
from crease.base.native import skip_mask
from crease.base.scene import Scene, open_scene
from crease.draw.plot import COLOURS, STYLE, new_figure, save_figure
from crease.replay.measures import motion_m
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory, load_trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from study.against_exact import Exact, box_corners, exact_force_N, exact_of
from study.points import read_points
from study.properties.scenes import bake_digest, image_of, load_meshes, load_scenes

F64 = npt.NDArray[np.float64]
FOLDER = ROOT / "firmware" / "contact"
BLUE, RED, GREEN, BLACK = COLOURS[0], COLOURS[1], COLOURS[2], COLOURS[7]
STIFFNESS_N_M = 1000.0
DEFAULT = ReplayOptions(stiffness_N_m=STIFFNESS_N_M)
EXTENT = replace(DEFAULT, response="extent")


def scene_of(name: str, options: ReplayOptions = DEFAULT) -> tuple[Scene, Trajectory, Exact]:
    """A test scene, its path, and the exact answer."""
    spec = load_specs(ROOT / "meshes" / "scenes.toml", MESHES)[name]
    exact = exact_of(EXACT, spec.exact, options)
    assert exact is not None
    return (
        open_scene(SCENES / f"{name}.crs"),
        load_trajectory(spec.path),
        exact,
    )


def forces_N(scene: Scene, path: Trajectory, options: ReplayOptions) -> F64:
    """Force of every tick, (n, 3)."""
    return run_path(scene, path, options)["force_N"].astype(np.float64)


def stiffness_seen(force_N: F64, moved_m: F64) -> F64:
    """|dF| / (k |dx|) of every tick, (n - 1,)."""
    step_N = np.linalg.norm(np.diff(force_N, axis=0), axis=1)
    return np.asarray(step_N / (STIFFNESS_N_M * np.maximum(moved_m, 1e-9)))


def draw_problem() -> Figure:
    """Round a right-angled edge: where the force points, and the stiffness that the loop sees."""
    scene, path, exact = scene_of("edge90_sphere")
    moved_m = motion_m(path.rows[:, 1:4], path.rows[:, 4:8], box_corners(scene))
    answers = {
        "45 degrees at any corner": (forces_N(scene, path, replace(DEFAULT, response="fixed45")), RED, 1.2),
        "crease": (forces_N(scene, path, DEFAULT), BLUE, 2.4),
        "exact": (exact_force_N(exact, STIFFNESS_N_M), BLACK, 0.8),
    }  # fmt: skip
    figure = new_figure(7.0, 3.0)
    left, right = figure.subplots(1, 2)
    for name, (force_N, colour, width) in answers.items():
        tilt_deg = np.degrees(np.arctan2(force_N[:, 0], force_N[:, 2]))
        touching = np.linalg.norm(force_N, axis=1) > 1.0
        left.plot(
            path.t_s, np.where(touching, tilt_deg, np.nan), color=colour, lw=width, label=name
        )
        right.plot(path.t_s[1:], stiffness_seen(force_N, moved_m), color=colour, lw=width)
    left.set_ylabel("direction of the force, deg")
    left.legend(loc="upper left")
    right.set_ylabel("stiffness seen / stiffness set")
    right.set_yscale("symlog", linthresh=1.0)
    for axes in (left, right):
        axes.set_xlabel("time, s")
    return figure


def draw_distance() -> Figure:
    """A section through the edge: how far interpolated samples are off, and what the tick sees."""
    scene, _, _ = scene_of("edge90_cube")
    low, high = (np.array(list(v)) for v in (scene.meta.static_min_m, scene.meta.static_max_m))
    edge, y = np.array([high[0], high[2]]), 0.5 * (low[1] + high[1])
    voxel_m = float(scene.meta.voxel_m)

    def phi_at(x: F64, z: F64) -> F64:
        points = np.stack([x, np.full_like(x, y), z], axis=-1).reshape(-1, 3).astype(np.float32)
        found = look_up(np.frombuffer(scene.image, np.uint8), points)
        return found.reshape(x.shape).astype(np.float64)

    reach = np.linspace(-0.65, 0.65, 261) * voxel_m
    x, z = np.meshgrid(edge[0] + reach, edge[1] + reach)
    dx, dz = x - edge[0], z - edge[1]
    outside = np.hypot(np.maximum(dx, 0.0), np.maximum(dz, 0.0))
    true_m = np.where((dx > 0) | (dz > 0), outside, np.maximum(dx, dz))
    figure = new_figure(7.0, 3.1)
    panels = list(figure.subplots(1, 2, sharey=True))
    seen = {
        "eight samples, interpolated": _interpolated(scene, phi_at, x, z),
        "the tick: planes where they meet": phi_at(x, z),
    }
    for axes, (title, phi) in zip(panels, seen.items(), strict=True):
        error_um = 1e6 * np.abs(phi - true_m)
        image = axes.pcolormesh(1e3 * dx, 1e3 * dz, error_um, cmap="magma_r", vmin=0.0, vmax=400.0)
        axes.contour(
            1e3 * dx, 1e3 * dz, phi, [-0.5e-3, 0.0, 0.5e-3], colors=[BLACK], linewidths=0.9
        )
        axes.set_title(
            f"{title}\nlargest error {error_um.max():.3g} um",
            fontsize=9,
        )
        axes.set_aspect("equal")
        axes.set_xlabel("mm from the edge")
        axes.grid(visible=False)
    figure.colorbar(image, ax=panels, label="error of the distance, um")
    return figure


def _interpolated(scene: Scene, phi_at: Callable[[F64, F64], F64], x: F64, z: F64) -> F64:
    """Distances at the corners of the voxels, interpolated between them."""
    voxel_m = float(scene.meta.voxel_m)
    u, w = (x - scene.meta.origin_m[0]) / voxel_m, (z - scene.meta.origin_m[2]) / voxel_m
    i, k = np.floor(u), np.floor(w)
    result = np.zeros_like(x)
    for di in (0, 1):
        for dk in (0, 1):
            corner = phi_at(
                scene.meta.origin_m[0] + (i + di) * voxel_m,
                scene.meta.origin_m[2] + (k + dk) * voxel_m,
            )
            result += corner * np.abs(1 - di - (u - i)) * np.abs(1 - dk - (w - k))
    return result


def draw_coverage() -> Figure:
    """Counting samples against weighing pieces, along the path, by their extent; and what finer samples buy."""
    scene, path, exact = scene_of("edge90_cube", EXTENT)
    figure = new_figure(7.0, 3.0)
    left, right = figure.subplots(1, 2)
    window = slice(880, 1180)
    answers = {
        "in or out": (forces_N(scene, path, replace(EXTENT, coverage="hard")), RED, 1.0),
        "pieces": (forces_N(scene, path, EXTENT), BLUE, 2.2),
        "exact": (exact_force_N(exact, STIFFNESS_N_M), BLACK, 0.8),
    }
    for name, (force_N, colour, width) in answers.items():
        size_N = np.linalg.norm(force_N[window], axis=1)
        left.plot(path.t_s[window], size_N, color=colour, lw=width, label=name)
    left.set_xlabel("time, s")
    left.set_ylabel("force, N")
    left.margins(y=0.25)
    left.legend(loc="upper right")
    _draw_convergence(right)
    return figure


def _draw_convergence(axes: Axes) -> None:
    points = [p for p in read_points(ROOT / "tests/bench/pareto.csv") if p.scene == "edge90_cube"]
    ours = sorted(
        (p.spacing_mm, p.force_rms_mm)
        for p in points
        if p.label == "extent" or (p.group == "sample spacing" and "extent" in p.label)
    )
    axes.loglog(*zip(*ours, strict=True), "o-", color=BLUE, label="pieces")
    hard = [(p.spacing_mm, p.force_rms_mm) for p in points if p.label == "published"]
    axes.loglog(*zip(*hard, strict=True), "s", color=RED, label="in or out")
    axes.set_xticks([s for s, _ in ours], [f"{s:g}" for s, _ in ours])
    axes.xaxis.minorticks_off()
    axes.set_xlabel("distance between samples, mm")
    axes.set_ylabel("force error / stiffness, mm RMS")
    axes.legend()


def draw_work() -> Figure:
    """Samples looked at in each tick, by what may be skipped; and answers that take several ticks."""
    scene, path, exact = scene_of("edge90_cube")
    figure = new_figure(7.0, 3.0)
    left, right = figure.subplots(1, 2)
    skips: Mapping[str, tuple[tuple[str, ...], str]] = {
        "look at all": ((), RED),
        "tree of spheres": (("top", "tree"), GREEN),
        "and what slept": (("top", "tree", "coherence"), BLUE),
    }
    for name, (chosen, colour) in skips.items():
        points = run_path(scene, path, replace(DEFAULT, skip=skip_mask(list(chosen))))[
            "points"
        ].astype(np.float64)
        left.plot(path.t_s, np.maximum(points, 0.8), color=colour, lw=0.9, label=name)
    left.set_yscale("log")
    left.set_ylabel("samples looked at in a tick")
    left.legend(loc="lower center")
    exact_N = exact_force_N(exact, STIFFNESS_N_M)
    for lookups, colour in ((32, RED), (40, GREEN), (None, BLUE)):
        force_N = forces_N(scene, path, replace(DEFAULT, lookups_max=lookups))
        error_mm = 1e3 / STIFFNESS_N_M * np.linalg.norm(force_N - exact_N, axis=1)
        name = "no bound" if lookups is None else f"{lookups} lookups a tick"
        right.plot(path.t_s, error_mm, color=colour, lw=0.9, label=name)
    right.set_ylabel("force error / stiffness, mm")
    right.legend(loc="upper right")
    for axes in (left, right):
        axes.set_xlabel("time, s")
    return figure


def _property_scene(name: str) -> tuple[Scene, Trajectory]:
    """A scene of the properties, baked when no image of it is there, and its path."""
    spec = load_scenes(ROOT / "meshes" / "property_scenes.toml")[name]
    image = image_of(spec, load_meshes(spec, MESHES), SCENES / "by_content", bake_digest())
    return image, load_trajectory(MESHES / spec.path)


def _draw_corner(axes: Axes) -> None:
    """The ball round a right-angled edge in section, with the force along its path."""
    scene, path, _ = scene_of("edge90_sphere")
    high = scene.meta.static_max_m
    x, z = (1e3 * (path.position_m[:, k] - high[k]) for k in (0, 2))
    force_N = forces_N(scene, path, DEFAULT)
    shown = np.flatnonzero(np.linalg.norm(force_N, axis=1) > 5.0)[::45]
    axes.fill([-90, 0, 0, -90], [0, 0, -90, -90], color="#e6ecf2")
    axes.plot([-90, 0, 0], [0, 0, -90], color="#33506b", lw=1.8)
    axes.plot(x, z, color="#8a8a8a", lw=0.9, ls=(0, (4, 2)))
    arrows: dict[str, Any] = {
        "angles": "xy",
        "scale_units": "xy",
        "scale": 0.35,
        "width": 0.008,
        "color": BLUE,
    }
    axes.quiver(x[shown], z[shown], force_N[shown, 0], force_N[shown, 2], **arrows)
    axes.set_aspect("equal")
    axes.set_xlim(-75, 80)
    axes.set_ylim(-75, 80)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title("ball round an edge: turns steadily")


def _draw_table(axes: Axes) -> None:
    """A flat block over a table's edge, 1 and 10 mm deep: force over stiffness and depth."""
    for name, depth_mm, style in (("over_edge_1", 1.0, "-"), ("over_edge_10", 10.0, "--")):
        scene, path = _property_scene(name)
        on = np.clip(0.5 - 1e3 * path.position_m[:, 0] / 60.0, 0.0, 1.0)
        for title, options, colour in (("extent", EXTENT, RED), ("way out", DEFAULT, BLUE)):
            share = np.linalg.norm(forces_N(scene, path, options), axis=1) / depth_mm
            flat = path.position_m[:, 2] < path.position_m[:, 2].min() + 1e-6
            label = f"{title}, {depth_mm:g} mm deep"
            axes.plot(100 * on[flat], share[flat], color=colour, ls=style, label=label)
    axes.set_xlim(100, 0)
    axes.set_ylim(0, 2.9)
    axes.set_xlabel("share of the block on the table, %")
    axes.set_ylabel("force / (stiffness x depth)")
    axes.set_title("flat block over a table's edge")
    axes.legend(loc="upper left", fontsize=7)


def _draw_pads(axes: Axes) -> None:
    """A tool with four pads pressed on a floor, beside one with a single pad: force over stiffness."""
    answers = {
        "extent, four pads": ("pads4", EXTENT, RED, 1.2),
        "way out, four pads": ("pads4", DEFAULT, BLUE, 2.2),
        "one pad": ("pads1", DEFAULT, BLACK, 0.8),
    }
    for label, (name, options, colour, width) in answers.items():
        scene, path = _property_scene(name)
        way_mm = np.linalg.norm(forces_N(scene, path, options), axis=1)
        axes.plot(1e3 * path.t_s, way_mm, color=colour, lw=width, label=label)
    axes.set_xlabel("tick")
    axes.set_ylabel("force / stiffness, mm")
    axes.set_title("four pads pressed on a floor")
    axes.legend(loc="center", fontsize=7)


def draw_edge_and_pads() -> Figure:
    """What the force does round a corner, over a table's edge, and on four pads."""
    figure = new_figure(10.0, 3.2)
    panels = figure.subplots(1, 3)
    for axes, draw in zip(panels, (_draw_corner, _draw_table, _draw_pads), strict=True):
        draw(axes)
    return figure


PICTURES: Mapping[str, Callable[[], Figure]] = {
    "problem.png": draw_problem,
    "distance.png": draw_distance,
    "coverage.png": draw_coverage,
    "work.png": draw_work,
    "edge_and_pads.png": draw_edge_and_pads,
}


def write_pictures(folder: Path, names: Sequence[str] = tuple(PICTURES)) -> list[Path]:
    """These pictures into a folder, made when it is missing; gives the files."""
    with mpl.rc_context(STYLE):
        figures = {name: PICTURES[name]() for name in names}
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        with (folder / name).open("wb") as file:
            save_figure(figure, file, "png")
    return [folder / name for name in names]


def main() -> None:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    parser.add_argument("--only", choices=PICTURES, help="one of them")
    args = parser.parse_args()
    for file in write_pictures(args.output, [args.only] if args.only else tuple(PICTURES)):
        print(file)


if __name__ == "__main__":
    main()
