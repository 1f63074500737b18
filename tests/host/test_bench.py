"""The benchmarks' arithmetic, and a quick run of each that bakes nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crease.bench.ablation import HEIGHTS_MM, SKIPS, motion
from crease.bench.pareto import Point, dominated, float32_um, read_points, write_points
from crease.bench.scaling import corner_poses, exponent
from crease.errors import CreaseError
from crease.experiment.setup import make_path
from crease.replay import ReplayOptions, run_path
from crease.scene import open_scene
from crease.trajectory import load_trajectory
from host_tools import Run

ROOT = Path(__file__).resolve().parent.parent.parent
IMAGE = ROOT / "build/scenes/edge90_cube.crs"
OURS = Point(
    "edge",
    "zones, default",
    "zones",
    2.0,
    2.0,
    12,
    8.0,
    9.0,
    1e5,
    1,
    1,
    0.01,
    0.02,
    0.1,
    0.3,
    0.01,
    1.0,
    1.0,
)


def test_points_read_back(tmp_path: Path) -> None:
    points = [OURS, replace(OURS, group="rival library", instructions=math.nan, label="a b")]
    write_points(tmp_path / "p.csv", points)
    back = read_points(tmp_path / "p.csv")
    assert back[0] == OURS
    assert back[1].label == "a b"
    assert math.isnan(back[1].instructions)
    (tmp_path / "p.csv").write_text("scene,group\nedge,x\n")
    with pytest.raises(CreaseError, match="cannot be read"):
        read_points(tmp_path / "p.csv")


def test_a_rival_that_is_faster_and_better_is_named() -> None:
    rival = replace(OURS, group="rival library", label="theirs", p50_us=7.0, force_rms_mm=0.02)
    silent = replace(rival, direction_p99_deg=math.nan)
    assert dominated([OURS, rival, silent]) == []
    better = replace(rival, direction_p99_deg=0.2)
    assert dominated([OURS, better]) == ["edge: theirs is faster and has less error of direction"]
    assert dominated([OURS, replace(better, p50_us=9.0)]) == []


def test_exponent_is_the_slope_of_the_logarithms() -> None:
    sizes = [1e3, 1e4, 1e5]
    assert exponent(sizes, [2 * s**0.3 for s in sizes]) == pytest.approx(0.3)


@pytest.mark.parametrize("side_mm", [26.0, 816.0])
def test_the_scaling_tools_touch_with_one_corner(side_mm: float) -> None:
    """Lowest corner 2 mm below the top of the cube of 100 mm, over the middle of its face."""
    w, x, y, z = corner_poses(100.0, side_mm)[0, 3:]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) - 0.5
    at = corners @ turn.T * side_mm * 1e-3 + corner_poses(100.0, side_mm)[0, :3]
    lowest = at[np.argmin(at[:, 2])]
    np.testing.assert_allclose(lowest, [-3e-3, -0.9e-3, 48e-3], atol=1e-9)


def test_ablation_motions_are_where_they_say() -> None:
    scene = open_scene(IMAGE)
    for name, height_mm in HEIGHTS_MM.items():
        path = make_path(motion(height_mm)[::40])
        rows = [run_path(scene, path, ReplayOptions(skip=skip)) for skip in SKIPS.values()]
        assert all((r["force_N"] == rows[0]["force_N"]).all() for r in rows)
        expected = max(0.0, -1e-3 * height_mm)
        assert rows[0]["depth_m"] == pytest.approx(expected, abs=2e-6), name


def test_float32_costs_less_than_a_tenth_of_a_micrometre() -> None:
    path = load_trajectory(ROOT / "build/meshes/edge90_cube.csv")
    assert 0.0 < float32_um(open_scene(IMAGE), path) < 0.1


def test_quick_ablation_writes_its_files(crease: Run, tmp_path: Path) -> None:
    folders = ("--meshes", ROOT / "build/meshes", "--images", ROOT / "build/scenes")
    said = crease("bench", "ablation", "-o", tmp_path / "b", "--quick", *folders)
    assert said.status == 0, said.err
    assert (tmp_path / "b" / "ablation.csv").exists()
    assert "NO" not in said.out
    again = crease("bench", "ablation", "-o", tmp_path / "b", "--quick", *folders)
    assert again.status == 1
    assert "--force" in again.err


@pytest.mark.slow
def test_quick_pareto_draws_the_rivals(crease: Run, tmp_path: Path) -> None:
    folders = (
        "--meshes",
        ROOT / "build/meshes",
        "--images",
        ROOT / "build/scenes",
        "--exact",
        ROOT / "tests/golden/exact",
    )
    write_points(
        tmp_path / "peers.csv",
        [replace(OURS, scene="edge90_cube", group="rival library", label="peer")],
    )
    said = crease(
        "bench", "pareto", "-o", tmp_path, "--quick", "--peers", tmp_path / "peers.csv", *folders
    )
    assert said.status == 0, said.err
    points = read_points(tmp_path / "pareto.csv")
    assert {"peer", "zones", "fixed45", "exact boolean"} <= {p.label for p in points}
    assert (tmp_path / "pareto.png").read_bytes().startswith(b"\x89PNG")
