"""The open benchmark: its files, exact wrenches against closed forms, judges, and a quick run with real bounds."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import make_six
import numpy as np
import pytest
import six_bench
import six_compare
import six_judge
import six_report
import six_run
import trimesh
from crease import Scene, bake, make_mesh
from crease.lab import six, six_drum
from crease.lab.run import run_experiment
from crease.lab.setup import Setup
from crease.lab.six_rivals import (
    HARDER,
    NAMES,
    RIVALS,
    ContactLevels,
    Field,
    ForceShading,
    Line,
    LineTool,
    StaticCoupling,
    make_rival,
    shells_of,
)
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation
from six_exact import Walls, wrenches
from six_judge import Case, Solids
from six_scenes import HAND, SCENES, SPRINGS, exact, over_edge

ROOT = Path(__file__).resolve().parents[2]
HERE = ROOT / "meshes" / "six"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The quick scenes as the script writes them."""
    folder = tmp_path_factory.mktemp("six")
    for name in (*six_bench.QUICK, "plate_3", "plate_needle", "stick_edge", "ball_joint"):
        make_six.write_scene(folder, name)
    return folder


@pytest.fixture(scope="module")
def plane(data: Path) -> Scene:
    """A cube and a plate of 3 mm."""
    case = Case.load(data, "plate_3")
    return bake(case.mesh("static"), case.mesh("tool"), voxel_m=1e-3, spacing_m=2e-3)


def test_every_scene_has_its_definition_and_nothing_else_is_there() -> None:
    assert {p.stem for p in HERE.glob("*.json")} == set(SCENES)
    assert sum(p.stat().st_size for p in HERE.iterdir() if p.is_file()) < 300_000


@pytest.mark.parametrize(
    "name",
    [
        "plate_1",
        "book_tip",
        "cylinder_edges",
        "ball_joint",
        "cube_plane",
        "plate_needle",
        "stick_edge",
    ],
)
def test_definitions_are_what_the_script_writes(name: str) -> None:
    kept = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    made = json.loads(json.dumps(make_six.definition(name, SCENES[name])))
    right, ours = (np.array(d["exact"].pop("rows")) for d in (kept, made))
    assert kept == made
    assert np.abs(right - ours).max() < 1e-6


def level_path(z_mm: float, ticks: int = 20) -> tuple[np.ndarray, Rotation]:
    """Straight down from 5 mm above."""
    at = np.zeros((ticks, 3))
    at[:, 2] = np.linspace(15.0, z_mm, ticks)
    return at, Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (ticks, 1)))


def test_exact_wrench_of_a_cube_on_a_plane_is_that_of_the_spring() -> None:
    corners = 10.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    row = wrenches(
        Walls(np.array([[0.0, 0.0, 1.0]]), np.zeros(1), corners), level_path(7.0), [19], SPRINGS
    )[0]
    assert row[1:] == pytest.approx([0.0, 0.0, 6.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_exact_wrench_of_a_tip_off_the_middle_balances_its_moment() -> None:
    """One point: what turns the tool is the force's arm about it."""
    tip = np.array([[8.0, 0.0, -10.0]])
    row = wrenches(
        Walls(np.array([[0.0, 0.0, 1.0]]), np.zeros(1), tip), level_path(6.0), [19], SPRINGS
    )[0]
    force, lean = row[3], row[5] / SPRINGS[1]
    held = Rotation.from_rotvec([0.0, lean, 0.0])
    assert row[5] == pytest.approx(
        np.cross(1e-3 * held.apply(tip[0]), [0.0, 0.0, force])[1], rel=1e-6
    )
    assert 6.0 + force / 2.0 + held.apply(tip[0])[2] == pytest.approx(0.0, abs=1e-6)


def test_exact_wrench_of_a_peg_pushed_aside_is_that_of_what_its_play_leaves() -> None:
    for name in ("peg_04", "peg_002"):
        play = SCENES[name].more["play_mm"]
        at = np.array([[0.0, 0.0, 15.0], [1.0, 0.0, 15.0]])
        turns = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
        walls = SCENES[name].walls
        assert walls is not None
        row = wrenches(walls(), (at, turns), [1], SPRINGS)[0]
        # Below its grip alone it is held: it leans until its upper edge or its tip is stopped too.
        assert -2.0 * (1.0 - 0.5 * play) - 0.02 < row[1] < -1.0


def test_depth_of_an_overlap_is_how_far_it_reaches_in(data: Path) -> None:
    case = Case.load(data, "cube_plane")
    solids = Solids(case.mesh("static"), case.mesh("tool"))
    for depth in (0.0, 0.01, 0.5):
        pose = np.array([0.0, 0.0, 10e-3 - 1e-3 * depth, 1.0, 0.0, 0.0, 0.0])
        assert solids.depth_mm(pose) == pytest.approx(depth, abs=2e-6)
    assert not solids.touches(np.array([0.0, 0.0, 10.001e-3, 1.0, 0.0, 0.0, 0.0]))


def test_depth_is_seen_where_no_corner_is_inside() -> None:
    """Two edges that cross, and a bar right through a plate: every corner of the overlap lies on both surfaces."""
    roof = make_mesh(
        trimesh.creation.box(
            extents=[20, 60, 20],
            transform=trimesh.transformations.rotation_matrix(np.pi / 4, [0, 1, 0]),
        ).vertices,
        trimesh.creation.box().faces,
        1e-3,
    )
    top_m = 20e-3 / np.sqrt(2.0)
    crossed = Solids(roof, roof)
    for deep_m in (0.1e-3, 2e-3):
        pose = np.r_[0.0, 0.0, 2.0 * top_m - deep_m, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
        found = crossed.depth_mm(pose)
        assert 0.5 * deep_m < 1e-3 * found < deep_m
    box = trimesh.creation.box(extents=[60, 60, 6])
    plate = make_mesh(box.vertices, box.faces, 1e-3)
    bar = trimesh.creation.box(extents=[10, 10, 60])
    through = Solids(plate, make_mesh(bar.vertices, bar.faces, 1e-3))
    assert through.depth_mm(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])) == pytest.approx(
        5.0, abs=0.01
    )


def test_judges_see_what_is_wrong(data: Path) -> None:
    """A method that is a spring to the hand's own depth, one tick late and stiff against the way in."""
    case = Case.load(data, "cube_plane")
    path = case.path
    z = path.rows[:, 3]
    wrench = np.zeros((len(path), 6))
    wrench[:, 2] = 2000.0 * np.maximum(11e-3 - z, 0.0)  # begins 1 mm too early
    solids = Solids(case.mesh("static"), case.mesh("tool"))
    assert six_judge.felt_early_N(solids, path, wrench) == pytest.approx(2.0, abs=0.1)
    assert six_judge.wrench_rms_mm(case, wrench)[0] == pytest.approx(1.0, abs=0.1)
    assert six_judge.inside_mm(solids, path.rows[:, 1:], 50) == pytest.approx(2.0, abs=1e-3)

    def gives(along: Trajectory) -> six_judge.Felt:
        """Pushes harder on the way out."""
        height = along.rows[:, 3]
        force = np.maximum(10e-3 - height, 0.0) * np.where(
            np.arange(len(along)) < len(along) / 2, 1000.0, 2000.0
        )
        felt = np.zeros((len(along), 6))
        felt[:, 2] = force
        return six_judge.Felt(felt, along.rows[:, 1:], np.zeros(len(along), np.int64))

    assert six_judge.loop_energy(case, gives) > 0.4
    steps = six_judge.Felt(np.round(wrench), path.rows[:, 1:], np.zeros(len(path), np.int64))

    def rough(along: Trajectory) -> six_judge.Felt:
        """In steps of 1 N."""
        felt = np.zeros((len(along), 6))
        felt[:, 2] = np.round(
            np.interp(np.arange(len(along)) / 2, np.arange(len(path)), wrench[:, 2])
        )
        return six_judge.Felt(felt, along.rows[:, 1:], np.zeros(len(along), np.int64))

    assert six_judge.change_halves(case, rough, steps) == pytest.approx(1.0)


def test_exact_wrench_of_a_stick_across_an_edge_is_that_of_shift_and_lean_in_series() -> None:
    """Level, 2 mm deep, 25 mm from its grip: it leans, but little."""
    at, turn = np.array([[45.0, 0.0, -2.0]]), Rotation.from_rotvec([[0.0, 0.0, 0.0]])
    wrench = over_edge((at, turn))[0]
    series = 2.0 / (1.0 / 2.0 + 25.0**2 / 5000.0)
    assert wrench[2] == pytest.approx(series, rel=0.01)
    assert 1e3 * wrench[4] == pytest.approx(25.0 * series, rel=0.01)
    away = over_edge((at + np.array([0.0, 0.0, 2.0]), turn))[0]
    assert not away.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(RIVALS))
def test_rival_holds_a_cube_on_a_plane_as_its_closed_form_says(name: str, plane: Scene) -> None:
    method = RIVALS[name](plane, SPRINGS)
    free, _ = method.tick(np.array([0.0, 0.0, 12e-3, 1.0, 0.0, 0.0, 0.0]))
    assert np.abs(free).max() < 1e-9
    for z in [*np.linspace(12e-3, 8e-3, 200), *[8e-3] * 400]:
        wrench, held = method.tick(np.array([0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0]))
    field = Field(plane)
    low = int(np.count_nonzero(field.samples_m[:, 2] < -10e-3 + 1e-6))
    if isinstance(method, ContactLevels):
        assert 4 <= method.contacts < low
        low = method.contacts
    right = {
        "god-object": 4.0,
        "static coupling": 4.0 * low * HARDER / (1.0 + low * HARDER),
        "voxmap": 4.0,
        "force shading": 4.0,
        "contact levels": 4.0 * low * HARDER / (1.0 + low * HARDER),
    }[name]
    within = 2.2 if name == "voxmap" else 0.01 * right  # a voxel is 2 N
    assert wrench[2] == pytest.approx(right, abs=within)
    assert np.abs(wrench[3:]).max() < 1e-3
    assert held[2] == pytest.approx(8e-3 + wrench[2] / SPRINGS[0], abs=2e-5)


@pytest.mark.slow
def test_line_feels_its_tip_as_deep_as_it_is(data: Path) -> None:
    """The needle's tip 2 mm into the plate, leant: k_t times depth, and no torque about the tip."""
    case = Case.load(data, "plate_needle")
    line = Line.of(case.spec)
    assert line is not None
    scene = bake(case.mesh("static"), case.mesh("tool"), voxel_m=1e-3, spacing_m=1e-3)
    tool = LineTool(scene, SPRINGS, line)
    lean = Rotation.from_rotvec([0.3, 0.2, 0.0]).as_quat()[[3, 0, 1, 2]]
    for z in np.linspace(1e-3, -2e-3, 150):
        wrench, held = tool.tick(np.array([1e-3, 2e-3, z, *lean]))
    assert wrench == pytest.approx([0.0, 0.0, 4.0, 0.0, 0.0, 0.0], abs=0.04)
    assert held[2] == pytest.approx(0.0, abs=2e-5)


@pytest.mark.slow
def test_line_across_an_edge_shifts_and_leans_as_two_springs_in_series(data: Path) -> None:
    case = Case.load(data, "stick_edge")
    line = Line.of(case.spec)
    assert line is not None
    scene = bake(case.mesh("static"), case.mesh("tool"), voxel_m=1e-3, spacing_m=1e-3)
    tool = LineTool(scene, SPRINGS, line)
    free, _ = tool.tick(np.array([45e-3, 0.0, 2e-3, 1.0, 0.0, 0.0, 0.0]))
    assert np.abs(free).max() < 1e-9
    for z in np.linspace(2e-3, -10e-3, 120):
        pose = np.array([45e-3, 0.0, z, np.cos(0.15), 0.0, np.sin(0.15), 0.0])
        wrench, _ = tool.tick(pose)
    at, turn = 1e3 * pose[None, :3], Rotation.from_quat(pose[None, [4, 5, 6, 3]])
    right = over_edge((at, turn))[0]
    assert 1e3 * right[4] > 20.0 * right[2] > 20.0
    for part in (slice(0, 3), slice(3, 6)):
        within = 0.01 * float(np.linalg.norm(right[part]))
        assert wrench[part] == pytest.approx(right[part], abs=within)


@pytest.mark.slow
def test_handles_of_a_line_carry_the_force_by_its_lever(plane: Scene) -> None:
    """Held back at 30 mm from the origin towards one handle, 50 mm off: 8 parts to 2."""
    tool = LineTool(plane, SPRINGS, Line(np.array([[-40e-3, 0, 0], [40e-3, 0, 0]])))
    motion = np.array([0.0, 0.0, 1e-3, 0.0, -1e-3 * 30.0 / 50.0, 0.0])
    ahead, behind = tool.handles_N(motion)
    assert ahead == pytest.approx([0.0, 0.0, 1.6])
    assert behind == pytest.approx([0.0, 0.0, 0.4])
    assert tool._wrench(motion) == pytest.approx([0, 0, 2.0, 0, -0.06, 0])


def test_tool_that_is_no_line_has_no_line(data: Path, plane: Scene) -> None:
    assert Line.of(Case.load(data, "plate_3").spec) is None
    assert make_rival(NAMES[-1], plane, SPRINGS) is None


@pytest.mark.slow
def test_shaded_force_goes_round_a_drum_of_facets_as_round_a_smooth_one(data: Path) -> None:
    """24 sides, each turns by 15 degrees: at once without shading, over its whole width with it."""
    needle = Case.load(data, "plate_needle")
    scene = six_drum.make_scene(needle.mesh("tool"))
    found = [six_compare.drum_turns(n, scene, needle) for n in ("god-object", "force shading")]
    assert None not in found
    plain, shaded = (f for f in found if f is not None)
    assert plain[0] > 12.0
    assert 3.0 < plain[1] < 7.5
    assert shaded[0] < 1.0
    assert shaded[1] < 1.0


@pytest.mark.slow
def test_shading_leaves_creases_alone(plane: Scene) -> None:
    """On the plate's top, 0.3 mm from its edge: the normal is the top's, though half of the disc lies off it."""
    method = ForceShading(plane, SPRINGS)
    up = np.array([[0.0, 0.0, 1.0]])
    assert method.shade(np.array([[29.7e-3, 0.0, 0.0]]), up) == pytest.approx(up, abs=1e-6)


@pytest.mark.slow
def test_contact_levels_without_a_threshold_are_the_static_coupling(data: Path) -> None:
    case = Case.load(data, "plate_3")
    scene = bake(case.mesh("static"), case.mesh("tool"), voxel_m=1e-3, spacing_m=2e-3)
    fine, levels = StaticCoupling(scene, SPRINGS), ContactLevels(scene, SPRINGS, 0.0)
    for pose in case.path.rows[:600:4, 1:]:
        right, ours = fine.tick(pose), levels.tick(pose)
        assert ours[0] == pytest.approx(right[0], abs=1e-6)
        assert ours[1] == pytest.approx(right[1], abs=1e-9)


@pytest.mark.slow
def test_contact_levels_are_coarse_where_it_is_not_felt(data: Path) -> None:
    """A ball in its socket: the larger the threshold, the fewer pieces, and the farther off."""
    case = Case.load(data, "ball_joint")
    scene = bake(case.mesh("static"), case.mesh("tool"), voxel_m=1e-3, spacing_m=1.5e-3)
    path = np.array([case.path.rows[t, 1:] for t in range(0, 300, 2)])
    fine = StaticCoupling(scene, SPRINGS)
    right = np.array([fine.tick(pose)[0] for pose in path])
    found = []
    for felt_m in (0.1e-3, 0.5e-3):
        levels = ContactLevels(scene, SPRINGS, felt_m)
        ours, pieces = np.empty((len(path), 6)), 0
        for i, pose in enumerate(path):
            ours[i] = levels.tick(pose)[0]
            pieces += levels.pieces
        off_m = float(np.abs(ours - right)[:, :3].max()) / SPRINGS[0]
        assert off_m < 2.0 * felt_m
        found.append((pieces, off_m))
    assert found[0][0] > 1.5 * found[1][0]
    assert found[0][1] < 0.5 * found[1][1]


def test_coarser_shells_part_the_samples_and_tell_how_far_they_are_off() -> None:
    """A flat grid is nowhere off, one over a ridge by half of its depth at most; pieces lie in pieces."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(32.0), np.arange(32.0)))
    for height, least, most in ((np.zeros_like(x), 0.0, 1e-9), (np.abs(x - 15.5), 0.3, 8.0)):
        shells = shells_of(np.column_stack([x, y, height]))
        assert [len(s.counts) for s in shells] == [16, 64, 256]
        assert all(s.counts.sum() == len(x) for s in shells)
        assert all(least <= s.off_m.max() <= most for s in shells)
        for coarse, fine in pairwise(shells):
            pairs = np.unique(np.column_stack([fine.piece, coarse.piece]), axis=0)
            assert len(pairs) == len(fine.counts)


@pytest.mark.slow
def test_quick_run_keeps_its_goals(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All, but the time of the tick, which is a quiet machine's to say."""
    monkeypatch.setattr(six_bench, "DATA", data)
    monkeypatch.setattr(six_bench, "IMAGES", tmp_path / "images")
    rows = six_bench.bench(six_bench.Extent(six_bench.QUICK, 20, 0, 30, 1, False), say=False)
    assert {r.scene for r in rows} == set(six_bench.QUICK)
    assert [(r.scene, r.what, r.measured) for r in rows if r.kept is False] == []
    six_report.write(tmp_path / "report", rows)
    text = (tmp_path / "report" / "SIX.md").read_text(encoding="utf-8")
    assert all(r.what in text for r in rows)
    assert (
        len((tmp_path / "report" / "six.csv").read_text(encoding="utf-8").splitlines())
        == len(rows) + 1
    )


def test_a_missed_goal_is_told_as_missed(tmp_path: Path) -> None:
    rows = [
        six_report.Row.most("s", "inside, mm", 0.02, 0.5),
        six_report.Row.least("s", "in", 50.0, 50.0),
    ]
    assert [r.kept for r in rows] == [False, True]
    six_report.write(tmp_path, rows)
    text = (tmp_path / "SIX.md").read_text(encoding="utf-8")
    assert "1 of 2 goals are kept" in text
    assert text.count("**missed**") == 1


def test_rows_of_one_scene_take_the_place_of_those_that_were_there(tmp_path: Path) -> None:
    rows = [six_report.Row.most(name, "inside, mm", 0.02, 0.5) for name in "abc"]
    six_report.write(tmp_path, rows, f"{six_report.SECTION}\nrest\n")
    before = (tmp_path / "SIX.md").read_text(encoding="utf-8")
    six_report.put(tmp_path, rows[1:2])
    assert (tmp_path / "SIX.md").read_text(encoding="utf-8") == before
    six_report.put(tmp_path, [six_report.Row.most("b", "inside, mm", 0.02, 0.01)])
    assert [r.kept for r in six_report.read(tmp_path / "six.csv")] == [False, True, False]
    text = (tmp_path / "SIX.md").read_text(encoding="utf-8")
    assert "1 of 3 goals are kept" in text
    assert text.endswith(f"{six_report.SECTION}\nrest\n")


def test_strokes_that_come_through_are_counted() -> None:
    """A method that holds nothing."""

    def through(path: Trajectory) -> six_judge.Felt:
        return six_judge.Felt(
            np.zeros((len(path), 6)), path.rows[:, 1:], np.zeros(len(path), np.int64)
        )

    assert six_compare.let_through(through, 5) == 5


def test_methods_are_kept_and_renewed_one_at_a_time(tmp_path: Path) -> None:
    found = [
        six_compare.Found("voxmap", "key", "inside, mm", 0.407),
        six_compare.Found("coupled tick", "key", "inside, mm", 0.00628),
        six_compare.Found("coupled tick", "all", "pegs in", 10.0),
    ]
    six_compare.write(tmp_path / "six_methods.csv", found)
    back = six_compare.read(tmp_path / "six_methods.csv")
    assert back == [found[1], found[2], found[0]]
    page = six_compare.page(back, 10, 50)
    assert "| key | voxmap | 0.407 |" in page
    assert "| corner | voxmap | not measured |" in page
    page = six_compare.page([*back, six_compare.Found(NAMES[-1], "all", "tick, ms", 1.0)], 10, 50)
    assert f"| corner | {NAMES[-1]} | {six_compare.NO_LINE} |" in page
    (tmp_path / "SIX.md").write_text("head\n\n## Beside other methods\n\nold", encoding="utf-8")
    six_report.renew(tmp_path, page)
    text = (tmp_path / "SIX.md").read_text(encoding="utf-8")
    assert text.startswith("head\n\n## Beside other methods\n")
    assert "old" not in text.split("\n")
    assert six_report.SECTION in page


def test_page_has_a_row_for_every_method_and_scene() -> None:
    """As it lies in the repository: nothing is left to be measured."""
    folder = ROOT / "tests" / "bench"
    kept = {(f.method, f.scene) for f in six_compare.read(folder / "six_methods.csv")}
    wanted = {(m, s) for m in six_compare.METHODS for s in (*six_compare.SCENES, "all", "drum")}
    assert {s for m, s in wanted - kept} == {
        s for s in six_compare.SCENES if "line_mm" not in spec(s)
    }
    assert {m for m, s in wanted - kept} == {NAMES[-1]}
    text = (folder / "SIX.md").read_text(encoding="utf-8")
    assert text.endswith(six_compare.page(six_compare.read(folder / "six_methods.csv"), 10, 50))


def spec(name: str) -> dict[str, object]:
    """What defines a scene."""
    read: dict[str, object] = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    return read


@pytest.mark.slow
def test_experiment_draws_every_method(tmp_path: Path) -> None:
    (tmp_path / "six").mkdir()
    for name in (*six.SCENES, "plate_needle"):
        make_six.write_scene(tmp_path / "six", name)
    (tmp_path / "out").mkdir()
    result = run_experiment("six", Setup(tmp_path, tmp_path, tmp_path / "out", every=40, repeat=1))
    for name in ("six", "six_drum"):
        assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    rows = result.tables[0].rows
    assert {row[1] for row in rows} == {"coupled tick", *NAMES}
    assert [row[0] for row in rows if row[1] == NAMES[-1]] == [six.SCENES["stick_edge"]]


@pytest.mark.slow
def test_peg_of_slim_triangles_is_held_outside_by_hands_that_err(tmp_path: Path) -> None:
    """Its side is 96 quads, 48 mm long: with pieces as its triangles lie it is 0.03 mm inside here."""
    make_six.write_scene(tmp_path, "peg_01")
    make_six.hands_file(tmp_path / "peg_hands.npz")
    case = Case.load(tmp_path, "peg_01")
    rows = six_bench.judge_hands(case, case.image(tmp_path), 2, 8)
    assert [(r.what, r.measured) for r in rows if not r.kept] == []


def test_guided_tool_that_touches_nothing_follows_its_hand() -> None:
    class Free:
        """Nothing there."""

        def tick(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """See Method."""
            return np.zeros(6), pose

    place = np.tile([1e-3, 0.0, 0.0], (1500, 1))
    place[0] = 0.0
    turns = Rotation.from_rotvec(np.tile([0.0, 0.02, 0.0], (1500, 1)))
    held, wrench = six_run.guide(Free(), HAND, place, turns)
    assert held[-1, :3] == pytest.approx(place[-1], abs=1e-6)
    assert not wrench.any()


def test_exact_rows_lie_where_the_scene_says() -> None:
    rows = exact(SCENES["book_drop"])
    assert [int(r[0]) for r in rows] == list(SCENES["book_drop"].ticks)
    assert max(abs(v) for r in rows for v in r[1:]) > 1.0
