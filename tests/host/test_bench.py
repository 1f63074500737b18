"""The benchmarks' arithmetic, and a quick run of each that bakes nothing."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import CreaseError
from crease.base.scene import open_scene
from crease.lab.setup import make_path
from crease.replay.cost import BOARD_WORK
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory, load_trajectory
from host_tools import Run, write_path
from scipy.spatial.transform import Rotation
from study.ablation import HEIGHTS_MM, SKIPS, motion
from study.against_exact import read_exact
from study.points import MEASURES, Point, less_error, read_points, verdict, write_records
from study.precision import compare, force_um
from study.program import IN_DOUBLE, ROW_IN_DOUBLE, build, run_in_double, widened
from study.scaling import corner_poses, exponent
from study.touched import GOAL_KIB, LINE, SECTIONS, build_counter, bytes_of, count

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(ROOT / "tests" / "bench")]

import report  # noqa: E402
import scene_tables  # noqa: E402

IMAGE = ROOT / "build/scenes/edge90_cube.crs"
EXACT = read_exact(ROOT / "tests/golden/exact/edge90_cube.csv.gz")
OURS = Point(
    "edge",
    "way out, default",
    "way out",
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
    write_records(tmp_path / "p.csv", points)
    back = read_points(tmp_path / "p.csv")
    assert back[0] == OURS
    assert back[1].label == "a b"
    assert math.isnan(back[1].instructions)
    (tmp_path / "p.csv").write_text("scene,group\nedge,x\n")
    with pytest.raises(CreaseError, match="cannot be read"):
        read_points(tmp_path / "p.csv")


def test_a_rival_that_is_faster_and_better_is_named() -> None:
    rival = replace(OURS, group="rival library", label="theirs", p50_us=7.0, force_rms_mm=0.02)
    assert verdict([OURS, rival]) == ["edge: 1 of 1 rivals faster, 0 of them more accurate too"]
    better = replace(rival, direction_p99_deg=0.2)
    assert verdict([OURS, better]) == [
        "edge: 1 of 1 rivals faster, 1 of them more accurate too",
        "  theirs, 7 us against 8: better in direction p99 0.2 against 0.3 deg; "
        "worse in force RMS 0.02 against 0.01 mm",
    ]
    assert verdict([OURS, replace(better, p50_us=9.0)]) == [
        "edge: 0 of 1 rivals faster, 0 of them more accurate too",
        "  not faster: theirs, 9 us against 8: better in direction p99 0.2 against 0.3 deg",
    ]


def test_a_rival_that_is_silent_is_not_more_accurate() -> None:
    silent = replace(
        OURS,
        group="rival response",
        label="quiet",
        p50_us=1.0,
        direction_p99_deg=math.nan,
        force_rms_mm=9.0,
    )
    assert less_error(silent, OURS) == []
    said = verdict([OURS, replace(silent, depth_rms_mm=0.001)])
    assert "direction p99 silent against 0.3 deg" in said[1]


def test_a_rival_that_wins_everywhere_dominates() -> None:
    half = {key: 0.5 * getattr(OURS, key) for key in MEASURES}
    lines = verdict([OURS, replace(OURS, group="rival response", label="wins", p50_us=1.0, **half)])
    assert lines[1].endswith("worse in nothing: it dominates")


def test_differences_within_noise_are_none() -> None:
    same = replace(
        OURS,
        group="rival response",
        p50_us=0.99 * OURS.p50_us,
        force_rms_mm=0.99 * OURS.force_rms_mm,
    )
    assert verdict([OURS, same]) == ["edge: 0 of 1 rivals faster, 0 of them more accurate too"]
    tiny = replace(OURS, depth_rms_mm=1e-7)
    assert less_error(replace(tiny, depth_rms_mm=1e-9), tiny) == []


def test_rivals_without_a_point_of_ours_are_an_error() -> None:
    with pytest.raises(CreaseError, match="none of ours"):
        verdict([replace(OURS, group="rival library")])


def test_report_says_what_the_csv_beside_it_hold() -> None:
    text = report.REPORT.read_text(encoding="utf-8")
    assert report.filled(text, report.HERE) == text


def test_tables_of_every_scene_say_what_the_csv_holds() -> None:
    for page, text in scene_tables.filled().items():
        assert page.read_text(encoding="utf-8") == text
    with pytest.raises(CreaseError, match="table"):
        scene_tables.with_table("no marks here", "table", "")


def test_report_without_its_marks_is_an_error() -> None:
    with pytest.raises(CreaseError, match="settings: begin"):
        report.filled("no marks here", report.HERE)


def test_exponent_is_the_slope_of_the_logarithms() -> None:
    sizes = [1e3, 1e4, 1e5]
    assert exponent(sizes, [2 * s**0.3 for s in sizes]) == pytest.approx(0.3)


@pytest.mark.parametrize("side_mm", [26.0, 816.0])
def test_the_scaling_tools_touch_with_one_corner(side_mm: float) -> None:
    """Lowest corner 2 mm below the top of the cube of 100 mm, over the middle of its face."""
    turn = Rotation.from_quat(corner_poses(100.0, side_mm)[0, 3:], scalar_first=True).as_matrix()
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


def test_widened_records_are_laid_out_as_c_lays_them_out() -> None:
    kind = np.dtype([("a", "<u4"), ("b", "<f4", 3), ("c", "<u2"), ("d", "<f4")], align=True)
    wide = widened(kind)
    fields = wide.fields
    assert fields is not None
    assert [fields[name][1] for name in "abcd"] == [0, 8, 32, 40]
    assert wide.itemsize == 48
    assert widened(np.dtype("<i2")) == np.dtype("<i2")


@pytest.mark.slow
def test_the_firmware_in_double_answers_alike(tmp_path: Path) -> None:
    """Single precision costs less than 0.1 um here, and more than nothing: it really is another build."""
    scene, whole = open_scene(IMAGE), load_trajectory(ROOT / "build/meshes/edge90_cube.csv")
    path = Trajectory(np.ascontiguousarray(whole.rows[800:1400]), whole.source)
    program = build(tmp_path / "double", IN_DOUBLE)
    double, single = run_in_double(program, scene, path, ReplayOptions()), run_path(scene, path)
    assert double["force_N"].dtype == np.float64
    um = force_um(single, double)
    assert 0.0 < um.max() < 0.1
    cost = compare(
        "edge90_cube", "way_out", single, double, {k: v[800:1400] for k, v in EXACT.items()}
    )
    assert cost.flips == 0
    assert cost.error_double_mm == pytest.approx(cost.error_single_mm, abs=1e-4)


def test_a_tick_that_decides_otherwise_is_counted() -> None:
    """The same rows but for one area more in one tick, and 1 um of force in another."""
    path = load_trajectory(ROOT / "build/meshes/edge90_cube.csv")
    rows = run_path(open_scene(IMAGE), path)
    other = rows.astype(ROW_IN_DOUBLE)
    other["areas"][900] += 1
    other["force_N"][1000] += [1e-3, 0.0, 0.0]
    cost = compare("edge90_cube", "way_out", rows, other, EXACT)
    assert (cost.flips, cost.choices, cost.at_tick) == (1, 1, 1000)
    assert cost.force_max_um == pytest.approx(1.0, rel=1e-3)


@pytest.mark.slow
def test_a_program_that_does_not_compile_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CreaseError, match="does not compile"):
        build(tmp_path / "none", ("-DCR_TREE_DEPTH_MAX=99",))


@pytest.mark.parametrize(
    "words",
    [
        ("pareto", "--search"),
        ("pareto", "--table", "meshes/property_scenes.toml"),
        ("touched", "--responses", "way_out"),
        ("ablation", "--scenes", "bar_u"),
        ("touched", "--repeat", "5"),
    ],
)
def test_an_option_that_a_study_does_not_heed_is_refused(
    crease: Run, tmp_path: Path, words: tuple[str, ...]
) -> None:
    said = crease("bench", *words, "-o", tmp_path / "out")
    assert said.status == 2
    assert f"error: {words[1]} is of properties" in said.err
    assert not (tmp_path / "out").exists()


def test_a_quick_study_has_its_own_number_of_runs(crease: Run, tmp_path: Path) -> None:
    said = crease("bench", "ablation", "--quick", "--repeat", "5", "-o", tmp_path / "out")
    assert (said.status, said.err.count("\n")) == (2, 1)
    assert "--quick: times are the least of 3 runs; leave out --repeat, or --quick" in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("properties", "--scenes", "bogus"), "bogus"),
        (("properties", "--table", "none.toml"), "none.toml"),
        (("touched", "--scenes", "bogus"), "bogus"),
    ],
)
def test_what_is_refused_late_leaves_no_folder(
    crease: Run, tmp_path: Path, words: tuple[str, ...], why: str
) -> None:
    folders = ("--meshes", ROOT / "build/meshes", "--images", ROOT / "build/scenes")
    said = crease("bench", *words, "-o", tmp_path / "new" / "out", *folders)
    assert said.status == 1
    assert said.err.startswith("error: ")
    assert why in said.err
    assert not (tmp_path / "new").exists()
    tmp_path.joinpath("out").mkdir()
    assert crease("bench", *words, "-o", tmp_path / "out", *folders).status == 1
    assert (tmp_path / "out").is_dir()  # it was there before


@pytest.mark.parametrize("name", ["pareto", "precision", "ablation"])
def test_missing_meshes_are_one_line_and_leave_nothing(
    crease: Run, tmp_path: Path, name: str
) -> None:
    said = crease("bench", name, "-o", tmp_path / "out", "--meshes", tmp_path / "none")
    assert said.status == 1
    assert (
        said.err
        == f"error: {tmp_path / 'none'}: is missing; run `make meshes`, or name the folder with --meshes\n"
    )
    assert not (tmp_path / "out").exists()


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
    write_records(
        tmp_path / "peers.csv",
        [replace(OURS, scene="edge90_cube", group="rival library", label="peer")],
    )
    said = crease(
        "bench", "pareto", "-o", tmp_path, "--quick", "--peers", tmp_path / "peers.csv", *folders
    )
    assert said.status == 0, said.err
    points = read_points(tmp_path / "pareto.csv")
    assert {"peer", "way out", "extent", "published", "fixed45", "exact boolean"} <= {
        p.label for p in points
    }
    assert (tmp_path / "pareto.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_bytes_that_a_tick_reads_are_counted(scene_crs: Path, tmp_path: Path) -> None:
    down = np.linspace([0.0, 0.0, 0.014], [0.0, 0.0, 0.008], 300)
    along = np.linspace([0.0, 0.0, 0.008], [0.015, 0.005, 0.008], 200)
    scene = open_scene(scene_crs)
    path = load_trajectory(write_path(tmp_path / "press.csv", np.concatenate([down, along])))
    program = build_counter(tmp_path / "touched")
    rows = count(program, scene, path)
    ticked = run_path(scene, path)
    assert (rows["contacts"] == ticked["contacts"]).all()
    lines = {name: rows["lines"][:, number - 1] for number, name in SECTIONS}
    size = bytes_of(rows)
    free, touching = ticked["nodes"] <= 1, ticked["contacts"] > 0
    assert free.any()
    # In free space: numbers of META, one entry of TOP, one brick and its four rows of samples.
    assert (size[free] <= LINE * 24).all()
    assert (lines["clusters"][free] == 0).all()
    # A cluster with samples inside: places and area vectors of 16 lanes at least, and never more than all of it.
    clusters = ticked["clusters"][touching]
    assert (LINE * lines["clusters"][touching] >= 6 * 64 * clusters).all()
    assert (size <= len(scene.image)).all()
    assert (lines["edges"] == 0).all()
    # An answer over several ticks reads less in each, and no more than the goal on the boards.
    boards = bytes_of(count(program, scene, path, BOARD_WORK))[touching]
    assert boards.mean() < 0.75 * size[touching].mean()
    assert np.percentile(boards, 99) <= 1024 * GOAL_KIB
