"""Accuracy of every test scene against the exact reference, and the cost of a tick, with the machine's name.

    python tests/bench/bench.py [--scene NAME ...] [--lookups N] [--repeat N] [--json OUT] [--csv OUT] [--figures DIR]

Needs build/scenes and build/meshes (make scenes). With `--csv tests/bench/accuracy.csv` and then
tests/bench/scene_tables.py the tables of README.md and REPORT.md are made again.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from dataclasses import asdict, astuple, fields, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from crease.bake.scene_list import SceneSpec, load_specs
from crease.base.errors import SceneError
from crease.base.scene import Scene, open_scene
from crease.lab.setup import machine
from crease.replay.measures import DEEP_M, Accuracy, angle_deg, direction_steps_deg
from crease.replay.replay import ReplayOptions, World, run_path
from crease.replay.trajectory import Trajectory, load_trajectory
from study.against_exact import exact_force_N, exact_of, measure

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
MESHES = ROOT / "build" / "meshes"
SCENES = ROOT / "build" / "scenes"
EXACT = ROOT / "tests" / "golden" / "exact"

METHODS = {
    "way_out": ReplayOptions(),
    "extent": ReplayOptions(response="extent"),
    "published": ReplayOptions(response="extent", coverage="hard"),
    "fixed45": ReplayOptions(response="fixed45"),
}
COLUMNS = (
    ("force_rms_mm", "F rms", "mm", "7.4f"),
    ("force_max_mm", "F max", "mm", "7.4f"),
    ("direction_p99_deg", "dir p99", "deg", "7.3f"),
    ("direction_max_deg", "dir max", "deg", "7.3f"),
    ("depth_max_mm", "depth", "mm", "7.4f"),
    ("torque_rms_mm", "T rms", "mm", "7.4f"),
    ("torque_max_mm", "T max", "mm", "7.4f"),
    ("amplification", "amp", "-", "7.3f"),
    ("amplification_exact", "exact", "-", "7.3f"),
    ("step_max_deg", "step", "deg", "7.3f"),
    ("step_exact_deg", "exact", "deg", "7.3f"),
)


def accuracy_table(
    specs: dict[str, SceneSpec], lookups_max: int | None
) -> dict[str, dict[str, Accuracy]]:
    """Print and return scene x method, each against the exact table of what it stands for."""
    head = " ".join(f"{title:>7s}" for _, title, _, _ in COLUMNS)
    units = " ".join(f"{unit:>7s}" for _, _, unit, _ in COLUMNS)
    print(f"{'scene':16s} {'method':9s} {head}\n{'':16s} {'':9s} {units}")
    results: dict[str, dict[str, Accuracy]] = {}
    for name, spec in specs.items():
        if spec.exact is None:
            continue
        scene, path = open_scene(SCENES / f"{name}.crs"), load_trajectory(spec.path)
        results[name] = {}
        for method, chosen in METHODS.items():
            options = replace(chosen, stiffness_N_m=spec.stiffness_N_m, lookups_max=lookups_max)
            found = measure(scene, path, exact_of(EXACT, spec.exact, options), options)
            results[name][method] = found
            values = " ".join(f"{getattr(found, key):{form}}" for key, _, _, form in COLUMNS)
            print(f"{name:16s} {method:9s} {values}", flush=True)
    return results


def write_accuracy(file: Path, results: dict[str, dict[str, Accuracy]]) -> None:
    """A row for each scene and method: every measure, four digits."""
    with file.open("w", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(("scene", "method", *(f.name for f in fields(Accuracy))))
        for scene, methods in results.items():
            for method, found in methods.items():
                rows.writerow((scene, method, *(f"{value:.4g}" for value in astuple(found))))


def cost_of(name: str, spec: SceneSpec, repeat: int) -> dict[str, float]:
    """Cost of a tick: least time of each pose over `repeat` replays, in us."""
    scene, path = open_scene(SCENES / f"{name}.crs"), load_trajectory(spec.path)
    rows = run_path(scene, path, repeat=repeat)
    touching = rows["areas"] > 0
    us = rows["tick_ns"] * 1e-3
    return {
        "contact_p50_us": float(np.median(us[touching])),
        "contact_p99_us": float(np.percentile(us[touching], 99)),
        "contact_max_us": float(us[touching].max()),
        "free_p50_us": float(np.median(us[~touching])) if (~touching).any() else 0.0,
        "free_away_us": free_cost_us(scene, path),
        "points_p50": float(np.median(rows["points"][touching])),
        "contacts_p50": float(np.median(rows["contacts"][touching])),
        "state_bytes": float(World(scene).size_bytes),
        "image_bytes": float(len(scene.image)),
    }


def free_cost_us(scene: Scene, path: Trajectory) -> float:
    """Median cost of a tick in free space: the same motion, one tool radius and 20 mm away from the static object."""
    rows = path.rows.copy()
    rows[:, 3] += (
        float(scene.meta.static_max_m[2])
        + float(scene.meta.tool_radius_m)
        + 0.02
        - rows[:, 3].min()
    )
    ticks = run_path(scene, Trajectory(rows, path.source), repeat=5)
    assert not ticks["areas"].any()
    return float(np.median(ticks["tick_ns"])) * 1e-3


def cost_table(specs: dict[str, SceneSpec], repeat: int) -> dict[str, dict[str, float]]:
    """Print and return scene x cost."""
    head = (
        f"{'contact us':>27s}",
        f"{'near':>6s}",
        f"{'free':>6s}",
        f"{'points':>7s}",
        f"{'inside':>7s}",
    )
    units = (
        f"{'p50':>9s}{'p99':>9s}{'max':>9s}",
        f"{'us':>6s}",
        f"{'us':>6s}",
        f"{'p50':>7s}",
        f"{'p50':>7s}",
    )
    print(f"\n{'scene':16s}", *head, f"{'state':>8s} {'image':>9s}")
    print(f"{'':16s}", *units, f"{'bytes':>8s} {'bytes':>9s}")
    results = {}
    for name, spec in specs.items():
        c = results[name] = cost_of(name, spec, repeat)
        print(
            f"{name:16s} {c['contact_p50_us']:9.2f}{c['contact_p99_us']:9.2f}{c['contact_max_us']:9.2f}"
            f" {c['free_p50_us']:6.2f} {c['free_away_us']:6.3f} {c['points_p50']:7.0f} {c['contacts_p50']:7.0f}"
            f" {c['state_bytes']:8.0f} {c['image_bytes']:9.0f}",
            flush=True,
        )
    return results


def draw_scene(name: str, spec: SceneSpec, folder: Path) -> Path:
    """Force and direction of every method beside the exact curve, as a picture."""
    scene, path = open_scene(SCENES / f"{name}.crs"), load_trajectory(spec.path)
    exact_N = {
        method: exact_force_N(exact, spec.stiffness_N_m)
        for method, options in METHODS.items()
        if (exact := exact_of(EXACT, spec.exact, options)) is not None
    }
    figure, axes = plt.subplots(3, 1, figsize=(9, 9), sharex=True, layout="constrained")
    for method, options in METHODS.items():
        force_N = run_path(scene, path, options)["force_N"].astype(np.float64)
        mine = method == next(iter(METHODS))
        style = {"lw": 1.8 if mine else 0.9, "zorder": 3 if mine else 2}
        axes[0].plot(path.t_s, np.linalg.norm(force_N, axis=1), label=method, **style)
        true_N = exact_N.get(method, force_N)
        counts = np.linalg.norm(true_N, axis=1) > DEEP_M * spec.stiffness_N_m
        turn = np.where(counts, angle_deg(force_N, true_N), np.nan)
        if method in exact_N:
            axes[1].plot(path.t_s, turn, label=method, **style)
        axes[2].plot(path.t_s[1:], direction_steps_deg(force_N, counts), label=method, **style)
    for method, line in (("way_out", "k--"), ("extent", "k:")):
        if method not in exact_N:
            continue
        true_N = exact_N[method]
        counts = np.linalg.norm(true_N, axis=1) > DEEP_M * spec.stiffness_N_m
        look: dict[str, Any] = {"lw": 1.0, "label": f"exact {method}", "zorder": 4}
        axes[0].plot(path.t_s, np.linalg.norm(true_N, axis=1), line, **look)
        axes[2].plot(path.t_s[1:], direction_steps_deg(true_N, counts), line, **look)
    axes[0].set_ylabel("|F|, N")
    axes[1].set_ylabel("angle to exact, deg")
    axes[2].set_ylabel("direction step, deg per tick")
    axes[2].set_xlabel("time, s")
    for axis in axes[1:]:
        axis.set_yscale("symlog", linthresh=0.1)
        axis.set_ylim(bottom=0.0)
    axes[0].legend(loc="upper right", ncols=4)
    axes[0].set_title(f"{name}: {spec.about}", fontsize=9)
    for axis in axes:
        axis.grid(alpha=0.3)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{name}.png"
    figure.savefig(target, dpi=110)
    plt.close(figure)
    return target


def main() -> int:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--scene", action="append", help="only these scenes")
    parser.add_argument(
        "--repeat", type=int, default=20, help="replays for the least cost of each pose"
    )
    parser.add_argument("--lookups", type=int, help="of a tick, for the accuracy of late answers")
    parser.add_argument("--json", type=Path, help="write all figures here")
    parser.add_argument(
        "--figures", type=Path, help="draw each scene beside the exact curve in this folder"
    )
    parser.add_argument("--csv", type=Path, help="write the figures of accuracy here")
    args = parser.parse_args()
    specs = load_specs(ROOT / "meshes" / "scenes.toml", MESHES)
    specs = {n: s for n, s in specs.items() if not args.scene or n in args.scene}
    print(f"machine: {machine()}\n")
    try:
        accuracy = accuracy_table(specs, args.lookups)
    except SceneError as error:
        print(f"error: {error}; run `make scenes`", file=sys.stderr)
        return 1
    if args.csv:
        write_accuracy(args.csv, accuracy)
    cost = cost_table(specs, args.repeat)
    if args.figures:
        for name in accuracy:
            print(draw_scene(name, specs[name], args.figures))
    if args.json:
        found = {n: {m: asdict(a) for m, a in row.items()} for n, row in accuracy.items()}
        args.json.write_text(
            json.dumps({"machine": machine(), "accuracy": found, "cost": cost}, indent=1) + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
