"""The open benchmark: its files, exact wrenches against closed forms, judges, and a quick run with real bounds."""

from __future__ import annotations

import json
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
from crease.lab import six
from crease.lab.run import run_experiment
from crease.lab.setup import Setup
from crease.lab.six_rivals import HARDER, RIVALS, Field
from crease.replay.trajectory import Trajectory
from scipy.spatial.transform import Rotation
from six_exact import Walls, wrenches
from six_judge import Case, Solids
from six_scenes import HAND, SCENES, SPRINGS, exact

ROOT = Path(__file__).resolve().parents[2]
HERE = ROOT / "meshes" / "six"
MISSED = {("corner", "change at half the step"): 0.75}
"""Goals of the quick scenes that are not kept, and what they are held to: tests/bench/SIX.md says so."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The quick scenes as the script writes them."""
    folder = tmp_path_factory.mktemp("six")
    for name in (*six_bench.QUICK, "plate_3"):
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
    "name", ["plate_1", "book_tip", "cylinder_edges", "ball_joint", "cube_plane"]
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
    right = {
        "god-object": 4.0,
        "static coupling": 4.0 * low * HARDER / (1.0 + low * HARDER),
        "voxmap": 4.0,
    }[name]
    within = 2.2 if name == "voxmap" else 0.01 * right  # a voxel is 2 N
    assert wrench[2] == pytest.approx(right, abs=within)
    assert np.abs(wrench[3:]).max() < 1e-3
    assert held[2] == pytest.approx(8e-3 + wrench[2] / SPRINGS[0], abs=2e-5)


@pytest.mark.slow
def test_quick_run_keeps_its_goals(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for the one that is known to be missed, and the time of the tick, which is a quiet machine's to say."""
    monkeypatch.setattr(six_bench, "DATA", data)
    monkeypatch.setattr(six_bench, "IMAGES", tmp_path / "images")
    rows = six_bench.bench(six_bench.Extent(six_bench.QUICK, 20, 0, 30, 1, False), say=False)
    assert {r.scene for r in rows} == set(six_bench.QUICK)
    missed = {(r.scene, r.what): r.measured for r in rows if r.kept is False}
    assert set(missed) <= set(MISSED)
    assert all(measured < MISSED[which] for which, measured in missed.items())
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


def test_strokes_that_come_through_are_counted() -> None:
    """A method that holds nothing."""

    def through(path: Trajectory) -> six_judge.Felt:
        return six_judge.Felt(
            np.zeros((len(path), 6)), path.rows[:, 1:], np.zeros(len(path), np.int64)
        )

    assert six_compare.let_through(through, 5) == 5


@pytest.mark.slow
def test_experiment_draws_every_method(tmp_path: Path) -> None:
    (tmp_path / "six").mkdir()
    for name in six.SCENES:
        make_six.write_scene(tmp_path / "six", name)
    (tmp_path / "out").mkdir()
    result = run_experiment("six", Setup(tmp_path, tmp_path, tmp_path / "out", every=40, repeat=1))
    assert (tmp_path / "out" / "six.png").read_bytes().startswith(b"\x89PNG")
    assert {row[1] for row in result.tables[0].rows} == {"coupled tick", *RIVALS}


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
