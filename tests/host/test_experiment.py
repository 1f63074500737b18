"""The experiments on thinned-out paths, and the pieces they are made of against closed forms and the golden tables."""

from __future__ import annotations

import gzip
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import CreaseError
from crease.base.native import RESPONSES
from crease.base.table import read_table
from crease.lab.direction import felt_radius_mm, wedge_path
from crease.lab.exact import exact_path, make_solids
from crease.lab.report import make_report, text_table
from crease.lab.run import NAMES, missing_inputs, run_experiment
from crease.lab.setup import Result, Setup, Table
from crease.lab.slender import edge_path
from crease.lab.timing import time_phases
from crease.replay.replay import ReplayOptions, run_path
from host_tools import Run

ROOT = Path(__file__).resolve().parent.parent.parent
MESHES, IMAGES = ROOT / "build" / "meshes", ROOT / "build" / "scenes"


def setup_in(folder: Path, every: int = 20) -> Setup:
    return Setup(MESHES, IMAGES, folder, every=every, repeat=1)


def check_files(result: Result, folder: Path) -> None:
    assert result.figures
    assert result.files
    for name, caption in result.figures:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
        assert caption.endswith(".")
    for table in result.tables:
        assert all(len(row) == len(table.heads) for row in table.rows)


@pytest.mark.parametrize(
    ("static", "tool", "path"),
    [("block45k", "cube60_50", "edge90_cube"), ("corner", "cube60_2700", "corner3_cube")],
)
def test_exact_contact_agrees_with_the_golden_tables(static: str, tool: str, path: str) -> None:
    """They come from another program, and are rounded to 1e-6 mm."""
    setup = setup_in(Path(), every=37)
    with gzip.open(
        ROOT / f"tests/golden/exact_extent/{path}.csv.gz", "rt", encoding="utf-8"
    ) as file:
        names = file.readline().strip().split(",")
        golden = dict(zip(names, np.loadtxt(file, delimiter=",")[::37].T, strict=True))
    solids = make_solids(setup.mesh(static), setup.mesh(tool))
    force, depth = exact_path(solids, setup.path(path).rows[:, 1:8])
    assert np.abs(1e3 * depth - golden["depth_mm"]).max() < 2e-6
    for axis, values in zip("xyz", force.T, strict=True):
        assert np.abs(1e3 * values - golden[f"f{axis}_mm"]).max() < 2e-6


@pytest.mark.slow
def test_penetration_does_not_depend_on_the_tessellation(tmp_path: Path) -> None:
    result = run_experiment("penetration", setup_in(tmp_path))
    check_files(result, tmp_path)
    table = read_table(tmp_path / "penetration.csv")
    exact = table["exact_extent_mm"]
    assert exact.max() > 4.0
    for count in (50, 100, 350, 800, 2700):
        assert np.abs(table[f"extent_{count}_mm"] - exact).max() < 0.1
        assert table[f"exact_way_out_{count}_mm"].max() > 2.0
        way_out = table[f"way_out_{count}_mm"]
        assert np.abs(way_out - table[f"exact_way_out_{count}_mm"]).max() < 0.1
    assert np.abs(table["as_published_50_mm"] - exact).max() > 0.5


def test_timed_phases_do_the_work_of_the_tick(tmp_path: Path) -> None:
    setup = setup_in(tmp_path)
    scene, path = setup.scene("block45k", "cube60_2700", 2.0, 2.0), setup.path("edge90_cube")
    for options in (ReplayOptions(), ReplayOptions(skip=0)):
        phases, ticks = time_phases(scene, path, options, 2), run_path(scene, path, options)
        for name in ("points", "nodes", "contacts", "areas"):
            assert np.array_equal(phases[name], ticks[name]), name
        touching = phases["areas"] > 0
        assert touching.any()
        for name in ("detect_ns", "relate_ns", "depth_ns"):
            assert (phases[name][touching] > 0).all(), name
        assert not phases["relate_ns"][phases["contacts"] == 0].any()


def test_only_responses_with_phases_are_timed(tmp_path: Path) -> None:
    setup = setup_in(tmp_path)
    scene, path = setup.scene("block45k", "cube60_2700", 2.0, 2.0), setup.path("edge90_cube")
    for response in RESPONSES.keys() - {"way_out"}:
        with pytest.raises(CreaseError, match="cannot be timed"):
            time_phases(scene, path, ReplayOptions(response=response), 1)


@pytest.mark.slow
def test_timing_names_the_machine_and_every_phase(tmp_path: Path) -> None:
    result = run_experiment("timing", setup_in(tmp_path))
    check_files(result, tmp_path)
    assert "one thread" in result.about
    table = read_table(tmp_path / "timing.csv")
    with_spheres, without = table["spheres"] == 1, table["spheres"] == 0
    assert (table["points"][with_spheres] * 5 < table["points"][without]).all()
    assert (table["detect_us"][with_spheres] < table["detect_us"][without]).all()


@pytest.mark.parametrize("angle", [60.0, 90.0, 120.0])
def test_wedge_path_is_as_deep_everywhere(angle: float) -> None:
    poses = wedge_path(angle, 0.0)
    half = np.radians(angle / 2.0)
    x, z = 1e3 * poses[:, 0], 1e3 * poses[:, 2]
    # Distance to the wedge: to its faces where the foot is on them, else to the edge.
    along = np.abs(x) * np.sin(half) - z * np.cos(half)
    face = np.abs(x) * np.cos(half) + z * np.sin(half)
    distance = np.where(along > 0.0, face, np.hypot(x, z))
    assert np.abs(distance - 40.0).max() < 1e-9
    assert np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).max() < 0.11e-3


def test_felt_radius_of_a_circle_is_its_radius() -> None:
    turn = np.linspace(0.0, 1.5, 800)[:, None]
    way = np.hstack([np.sin(turn), 0.0 * turn, np.cos(turn)])
    assert felt_radius_mm(5.0 * way, 0.04 * way) == pytest.approx(40.0, rel=1e-6)


@pytest.mark.slow
def test_direction_fixed45_jumps_by_half_the_turn_and_the_way_out_does_not(tmp_path: Path) -> None:
    result = run_experiment("direction", setup_in(tmp_path, every=1))
    check_files(result, tmp_path)
    turn = {(row[0], row[1]): float(row[2]) for row in result.tables[0].rows if row[2]}
    for angle in (60, 90, 120):
        name = f"{angle} degrees"
        assert turn[name, "fixed 45 degrees"] == pytest.approx((180.0 - angle) / 2.0, abs=0.5)
        assert turn[name, "way out"] < 0.5
        assert turn[name, "extent"] < 0.5
    assert turn["three faces", "extent"] < 0.5
    assert turn["three faces", "way out"] < 0.55  # exact: 0.44


def test_slender_tools_lie_on_the_edge() -> None:
    poses = edge_path(3.0, (25.0, 95.0), 200)[40:]
    way = np.column_stack([poses[:, 3] ** 2 - poses[:, 5] ** 2, -2.0 * poses[:, 3] * poses[:, 5]])
    across = np.abs(way[:, 0] * poses[:, 2] - way[:, 1] * poses[:, 0])
    assert across == pytest.approx(
        2e-3, abs=1e-12
    )  # the middle line, 1 mm less than half the thickness over the edge


@pytest.mark.slow
def test_slender_spheres_leave_little_to_look_at(tmp_path: Path) -> None:
    check_files(run_experiment("slender", setup_in(tmp_path)), tmp_path)
    table = read_table(tmp_path / "slender.csv")
    for tool in ("screwdriver", "spanner"):
        few, all_ = table[f"{tool}_with_spheres_points"], table[f"{tool}_without_spheres_points"]
        assert np.median(few) * 10 < np.median(all_)
        inside = table[f"{tool}_with_spheres_contacts"]
        assert np.array_equal(inside, table[f"{tool}_without_spheres_contacts"])
        assert inside.max() > 0


@pytest.mark.slow
def test_zones_shows_one_and_two_zones_and_two_areas(tmp_path: Path) -> None:
    check_files(run_experiment("zones", setup_in(tmp_path)), tmp_path)
    table = read_table(tmp_path / "zones.csv")
    areas = [set(table["area"][table["case"] == k].astype(int)) for k in range(3)]
    assert [len(a) for a in areas] == [1, 1, 2]
    assert [int(np.count_nonzero(table["case"] == k)) for k in range(3)] == [1, 2, 2]
    assert (table["weight_mm2"] > 0.0).all()


@pytest.fixture(scope="module")
def pushed_through(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of the pushes through a plate, into a wall, and aside in a hole."""
    folder = tmp_path_factory.mktemp("thin")
    check_files(run_experiment("thin-and-deep", setup_in(folder, every=4)), folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("response", ["way_out", "extent"])
def test_a_plate_turns_the_force_as_the_middle_passes(pushed_through: Path, response: str) -> None:
    plate = read_table(pushed_through / "plate.csv")
    pushed, felt = plate["pushed_mm"], plate[f"{response}_mm"]
    assert (felt[(pushed > 1.0) & (pushed < 14.5)] > 0.8).all()
    assert (felt[(pushed > 16.5) & (pushed < 29.0)] < -0.8).all()
    held = (pushed > 0.2) & (pushed < 30.0)
    assert np.abs(plate["sphere_proxy_mm"] - plate["expected_mm"])[held].max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("response", ["way_out", "extent"])
def test_the_way_out_of_a_thick_wall_is_exact(pushed_through: Path, response: str) -> None:
    """While a part of the cube sticks out."""
    deep = read_table(pushed_through / "fully_inside.csv")
    shallow = deep["pushed_mm"] < 19.0
    assert np.abs(deep[f"{response}_mm"] - deep["expected_mm"])[shallow].max() < 0.01


@pytest.mark.slow
def test_a_swallowed_cube_has_no_extent(pushed_through: Path) -> None:
    deep = read_table(pushed_through / "fully_inside.csv")
    assert (deep["extent_mm"][deep["pushed_mm"] > 21.0] == 0.0).all()


@pytest.mark.slow
def test_a_peg_is_led_back_by_about_its_way_and_not_by_its_extent(pushed_through: Path) -> None:
    peg = read_table(pushed_through / "peg_in_a_hole.csv")
    free, pressed = peg["pushed_mm"] < 0.15, peg["pushed_mm"] > 0.3
    expected = peg["expected_mm"][pressed]
    for response in ("way_out", "extent"):
        assert (peg[f"{response}_mm"][free] == 0.0).all()
        assert (peg[f"{response}_mm"][pressed] < expected).all()
    assert (peg["way_out_mm"][pressed] > 1.5 * expected).all()
    assert (peg["extent_mm"][pressed] < 5.0 * expected).all()


def test_report_is_one_page_that_needs_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"\x89PNG picture")
    table = Table("Caption & more", ("head", "other"), (("1", "<2>"),))
    result = Result(
        "zones", "Title", "About.", [table], [("a.png", "A figure.")], ["a.csv"], ["Found."]
    )
    page = make_report([result], tmp_path)
    assert "&lt;2&gt;" in page
    assert "Caption &amp; more" in page
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources
    assert all(s.startswith(("data:image/png;base64,", "#")) for s in sources)
    assert text_table(table).splitlines()[1] == "head  other"


def test_command_line_says_what_is_wrong(crease: Run, tmp_path: Path) -> None:
    said = crease("experiment", "penetration", "-o", tmp_path / "out", "--meshes", tmp_path)
    assert said.status == 1
    assert "edge90_cube.csv: is missing, and 6 more; run `make meshes`" in said.err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    said = crease("experiment", "timing", "-o", tmp_path / "full")
    assert said.status == 1
    assert "holds files already" in said.err
    assert crease("experiment", "magic", "-o", tmp_path / "x").status == 2
    assert crease("experiment", "timing", "-o", tmp_path / "x", "--every", "0").status == 2


def test_too_large_a_step_leaves_no_folder(crease: Run, tmp_path: Path) -> None:
    said = crease(
        "experiment", "slender", "-o", tmp_path / "out", "--every", "1000000",
        "--meshes", MESHES, "--images", IMAGES,
    )  # fmt: skip
    assert said.status == 1
    assert "--every 1000000: leaves 1 of the 600 poses" in said.err
    assert not (tmp_path / "out").exists()


def test_so_few_poses_that_nothing_is_left_are_refused(tmp_path: Path) -> None:
    setup = Setup(MESHES, IMAGES, tmp_path, every=1_000_000)
    with pytest.raises(CreaseError, match="--every 1000000: leaves 1 of the 1,992 poses"):
        setup.path("edge90_cube")


@pytest.mark.parametrize(
    ("name", "every", "left"),
    [
        ("slender", 1_000_000, "1 of the 600 poses"),
        ("thin-and-deep", 1_000_000, "1 of the 691 poses"),
        ("six", 500, "no pose whose exact answer is known"),
    ],
)
def test_an_experiment_that_nothing_is_left_of_is_refused(
    name: str, every: int, left: str, tmp_path: Path
) -> None:
    with pytest.raises(CreaseError, match=f"--every {every}: leaves {left}"):
        run_experiment(name, setup_in(tmp_path, every=every))


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_says_beforehand_what_it_reads(name: str, tmp_path: Path) -> None:
    assert missing_inputs([name], MESHES) == []
    named = missing_inputs([name], tmp_path)
    module = sys.modules[f"crease.lab.{name.replace('-', '_')}"]
    source = Path(str(module.__file__)).read_text("utf-8")
    for call in re.findall(r'\.(?:mesh|path|scene)\("([\w.]+)"', source):
        assert call in {path.name.removesuffix(path.suffix) for path in named}


def test_all_inputs_are_checked_before_the_first_experiment(
    crease: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = tmp_path / "some"
    shutil.copytree(MESHES, some, symlinks=True)
    (some / "peg.stl").unlink()
    monkeypatch.setattr("crease.verbs.experiment.run_experiment", None)
    said = crease("experiment", "all", "-o", tmp_path / "out", "--meshes", some)
    assert said.status == 1
    assert said.err == (
        f"error: {some / 'peg.stl'}: is missing; run `make meshes`, or name the folder with --meshes\n"
    )
    assert not (tmp_path / "out").exists()


def test_one_experiment_that_fails_leaves_a_page_of_the_others(
    crease: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(name: str, _setup: Setup) -> Result:
        if name == "zones":
            raise CreaseError("u_tool.stl: is no mesh")
        return Result(name, f"Title of {name}", "About.")

    monkeypatch.setattr("crease.verbs.experiment.run_experiment", run)
    said = crease("experiment", "all", "-o", tmp_path / "out", "--meshes", MESHES)
    page = tmp_path / "out" / "report.html"
    assert said.status == 1
    assert said.err.splitlines() == [
        "warning: zones failed: u_tool.stl: is no mesh",
        f"error: {page}: is without zones, which failed",
    ]
    text = page.read_text("utf-8")
    assert "<li>zones: failed: u_tool.stl: is no mesh</li>" in text
    assert all(f"Title of {name}<" in text for name in NAMES if name != "zones")


@pytest.mark.slow
def test_command_writes_table_and_names(crease: Run, tmp_path: Path) -> None:
    said = crease("experiment", "penetration", "-o", tmp_path / "out", "--every", "50",
                  "--meshes", MESHES, "--images", IMAGES)  # fmt: skip
    assert said.status == 0, said.err
    assert (tmp_path / "out" / "penetration.txt").read_text() in said.out
    assert set(NAMES) >= {"penetration", "timing", "direction", "slender", "zones", "thin-and-deep"}
