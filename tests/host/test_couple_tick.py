"""The held tool that finds its own contacts, judged by booleans of the meshes; `crease replay --couple`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import manifold3d as mf
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease import Scene, bake, make_mesh
from crease.base.errors import SceneError
from crease.base.native import lib
from crease.cli import main
from crease.replay.contacts import Watcher, find_areas, find_contacts
from crease.replay.replay import CoupleOptions, ReplayOptions, World, run_path
from crease.replay.trajectory import Trajectory, check_rows
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]

K_T = 2000.0
INSIDE_MAX_MM = 0.02
HALF_MM = 10.0


def box(x: float, y: float, z: float) -> Any:
    """About the origin, mm."""
    return mf.Manifold.cube([x, y, z], True)


def vertices_of(solid: Any) -> F64:
    """(n, 3), mm."""
    return np.asarray(solid.to_mesh().vert_properties[:, :3], np.float64)


def scene_of(static: Any, tool: Any, spacing_m: float, voxel_m: float) -> Scene:
    """Baked."""
    meshes = [make_mesh(vertices_of(s), s.to_mesh().tri_verts, 1e-3) for s in (static, tool)]
    return bake(*meshes, spacing_m=spacing_m, voxel_m=voxel_m)


def inside_mm(static: Any, tool: Any, at_m: F64, turn: Rotation) -> float:
    """How deep the overlap of the two reaches below the surface of either."""
    both = static ^ tool.transform(np.column_stack([turn.as_matrix(), 1e3 * at_m]))
    if both.is_empty():
        return 0.0
    places, deep = vertices_of(both), 0.0
    for solid, seen in ((static, places), (tool, turn.inv().apply(places - 1e3 * at_m))):
        mesh = trimesh.Trimesh(vertices_of(solid), solid.to_mesh().tri_verts, process=False)
        deep = max(deep, float(trimesh.proximity.closest_point(mesh, seen)[1].max()))
    return deep


def path_of(at_m: F64, turns: Rotation) -> Trajectory:
    """One pose a millisecond."""
    x, y, z, w = turns.as_quat().T
    rows = np.column_stack([1e-3 * np.arange(len(at_m)), at_m, w, x, y, z])
    return check_rows(rows, "path")


def held_of(row: Any) -> tuple[F64, Rotation]:
    """Pose of the held tool."""
    w, x, y, z = row["display_rot"]
    return np.asarray(row["display_pos_m"], np.float64), Rotation.from_quat([x, y, z, w])


PLATE, CUBE = box(60, 60, 1), box(2 * HALF_MM, 2 * HALF_MM, 2 * HALF_MM)


@pytest.fixture(scope="module")
def plate() -> Scene:
    """1 mm thin, and a cube of 20 mm."""
    return scene_of(PLATE, CUBE, 2e-3, 1e-3)


def stroke(turn: Rotation, speed_m_s: float) -> Trajectory:
    """Down to where the lowest corner is 10 mm below the plate's top."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF_MM
    low_m = 1e-3 * float(turn.apply(corners)[:, 2].min())
    z = np.arange(20e-3, -9.5e-3 - low_m, -1e-3 * speed_m_s)
    at_m = np.column_stack([np.full(len(z), 3e-3), np.zeros(len(z)), z])
    return path_of(at_m, Rotation.from_quat(np.tile(turn.as_quat(), (len(z), 1))))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_plate_pressed_deeper_than_it_is_thick_holds(plate: Scene, friction: float) -> None:
    rng = np.random.default_rng(4)
    options = ReplayOptions(K_T, couple=CoupleOptions(friction=friction))
    for turn in Rotation.from_rotvec(rng.normal(0.0, 1.0, (20, 3))):
        path = stroke(turn, float(rng.uniform(0.2, 1.0)))
        rows = run_path(plate, path, options)
        assert not rows["faults"].any()
        assert (rows["display_pos_m"][:, 2] > 9e-3).all()  # never through
        touches_not = np.array(
            [
                inside_mm(PLATE, CUBE, p[:3], turn) == 0.0
                for p in path.rows[:, 1:][rows["areas"] > 0][:1]
            ]
        )
        assert not touches_not.any()  # nothing is felt before it touches
        at_m, held = held_of(rows[-1])
        assert inside_mm(PLATE, CUBE, at_m, held) < INSIDE_MAX_MM
        assert np.linalg.norm(rows["force_N"][-1]) > 5.0


def tip() -> Any:
    """A pyramid on its apex, mm."""
    base = [[x, y, 15] for x in (-3, 3) for y in (-3, 3)]
    return mf.Manifold.hull_points(np.array([[0, 0, 0], *base], np.float64))


def groove() -> Any:
    """A block with a V of 90 degrees along y, mm."""
    block = box(40, 40, 20).translate([0, 0, -10])
    return block - box(10, 60, 10).rotate([0, 45, 0])


def thin_corner() -> Any:
    """A floor and a wall, 1 mm each, mm."""
    floor = box(40, 40, 1).translate([0, 0, -0.5])
    return floor + box(1, 40, 20).translate([0.5, 0, 9])


def press(at_mm: tuple[F64, F64], turn: Rotation) -> Trajectory:
    """To a place in 160 ms, and rest there."""
    way = np.minimum(np.arange(280) / 160.0, 1.0)[:, np.newaxis]
    at_m = 1e-3 * (at_mm[0] + way * (at_mm[1] - at_mm[0]))
    return path_of(at_m, Rotation.from_quat(np.tile(turn.as_quat(), (len(at_m), 1))))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_tip_between_walls_is_held_by_both_and_rests(friction: float) -> None:
    lean, level = Rotation.from_rotvec([0.0, -0.6, 0.0]), Rotation.identity()
    options = ReplayOptions(K_T, couple=CoupleOptions(friction=friction))
    for static, ways, turn in (
        (groove(), [((1.0, 0.0, 2.0), (0.6, 0.0, -9.0))], level),
        (
            thin_corner(),
            [((-4.0, 0.0, 2.0), (x, 0.0, z)) for x, z in ((1, -1), (2, -2), (8, -4), (4, -8))],
            lean,
        ),
    ):
        scene = scene_of(static, tip(), 2e-3, 1e-3)
        for start, end in ways:
            rows = run_path(scene, press((np.array(start), np.array(end)), turn), options)
            assert not rows["faults"].any()
            assert not rows["late_ticks"][-100:].any()
            assert np.ptp(rows["force_N"][-100:], axis=0).max() < 0.01  # no swing
            for row in rows[::20]:
                assert inside_mm(static, tip(), *held_of(row)) < INSIDE_MAX_MM


def test_cube_that_turns_on_a_plate_gets_no_energy_from_it(plate: Scene) -> None:
    a = np.linspace(0.0, 2.0 * np.pi, 2001)
    at_m = np.column_stack(
        [3e-3 * np.sin(a), 2e-3 * np.sin(2 * a), 11e-3 - 5e-3 * np.sin(a / 2) ** 2]
    )
    turns = Rotation.from_rotvec(
        np.column_stack([0.05 * np.sin(a), 0.08 * np.sin(3 * a), 0.03 * np.sin(a)])
    )
    path = path_of(at_m, turns)
    moved = np.diff(path.rows[:, 1:4], axis=0)
    turned = (turns[1:] * turns[:-1].inv()).as_rotvec()
    for friction in (0.0, 0.3):
        options = ReplayOptions(K_T, couple=CoupleOptions(friction=friction))
        rows = run_path(plate, path, options)
        force, torque = (
            0.5 * (rows[name][1:] + rows[name][:-1]) for name in ("force_N", "torque_Nm")
        )
        given = float(np.sum(force * moved) + np.sum(torque * turned))
        stored = 0.5 * float((np.linalg.norm(rows["force_N"], axis=1) ** 2).max()) / K_T
        assert given < 1e-3 * stored
        assert (friction > 0) == (given < -0.1 * stored)


def round_an_edge() -> F64:
    """Middles of a ball of 10 mm that goes 2 mm deep over a block, round its edge, and 20 mm down, m."""
    angle = np.linspace(0.0, np.pi / 2, 120)
    arc = np.column_stack([20 + 8 * np.sin(angle), 1.3 + 0 * angle, 8 * np.cos(angle)])
    over = np.linspace([12, 1.3, 8], arc[0], 60)
    down = np.linspace(arc[-1], [28, 1.3, -20], 120)
    return 1e-3 * np.concatenate([over, arc, down])


def test_a_ball_of_facets_does_not_hang_from_an_edge() -> None:
    """Corners between facets stand out beyond the pieces beside them: one hung there by 25 mm, where 2 is right."""
    ball = trimesh.creation.icosphere(3, 10.0)
    block = box(40, 60, 20).translate([0, 0, -10])
    meshes = [
        make_mesh(vertices_of(block), block.to_mesh().tri_verts, 1e-3),
        make_mesh(ball.vertices, ball.faces, 1e-3),
    ]
    scene = bake(*meshes, spacing_m=1e-3, voxel_m=2e-3)
    at_m = round_an_edge()
    for turn in Rotation.random(4, rng=np.random.default_rng(1)):
        options = ReplayOptions(stiffness_N_m=K_T, couple=CoupleOptions())
        rows = run_path(scene, path_of(at_m, Rotation.concatenate([turn] * len(at_m))), options)
        pull_mm = 1e3 / K_T * np.linalg.norm(rows["force_N"], axis=1)
        assert 1.9 < pull_mm.max() < 2.3


def test_replay_couple_writes_the_held_tool(
    plate: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, poses, table = (tmp_path / name for name in ("s.crs", "path.csv", "out.csv"))
    plate.save(scene)
    rows = stroke(Rotation.identity(), 0.5).rows
    names = "t_s,x_m,y_m,z_m,qw,qx,qy,qz"
    np.savetxt(poses, rows, delimiter=",", header=names, comments="")
    line = ["replay", str(scene), str(poses), "-o", str(table), "--force", "--repeat", "1"]
    assert main([*line, "--couple", "--friction", "0.3", "--stiffness", "2000"]) == 0
    answered = np.genfromtxt(table, delimiter=",", names=True)
    assert answered["dz_m"].min() == pytest.approx(10.5e-3, abs=2e-5)
    assert answered["fz_N"][-1] == pytest.approx(K_T * (10.5e-3 - rows[-1, 3]), rel=1e-2)
    assert (answered["fz_N"][rows[:, 3] > 10.51e-3] == 0.0).all()
    assert "from the held tool" in capsys.readouterr().out
    for more, text in (
        (["--friction", "0.3"], "--friction is of a held tool"),
        (["--stiffness-turn", "2"], "--stiffness-turn is of a held tool"),
        (["--couple", "--lookups", "64"], "--couple has no --lookups"),
        (["--couple", "--force-max", "1"], "--couple has no --force-max"),
        (["--couple", "--response", "extent"], "no response but its own"),
    ):
        assert main([*line, *more]) == 2
        assert text in capsys.readouterr().err
    assert main([*line[:4], str(tmp_path / "o.mcap"), "--couple"]) == 2
    assert "--couple runs a path" in capsys.readouterr().err


def test_what_says_nothing_of_a_held_tool_is_refused(plate: Scene) -> None:
    path = stroke(Rotation.identity(), 1.0)
    for name, value in (("force_max_N", 1.0), ("lookups_max", 64), ("skip", 0)):
        options = ReplayOptions(**{name: value}, couple=CoupleOptions())  # type: ignore[arg-type]
        with pytest.raises(SceneError, match=f"{name}: a held tool has none"):
            run_path(plate, path, options)
    coupled = ReplayOptions(couple=CoupleOptions())
    with pytest.raises(SceneError, match="runs a path"):
        World(plate, coupled).tick([0, 0, 0.1, 1, 0, 0, 0])
    for shows in (find_areas, find_contacts):
        with pytest.raises(SceneError, match="the world's own answer"):
            shows(plate, path, coupled)
    with pytest.raises(SceneError, match="the world's own answer"):
        Watcher(plate, coupled)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"centre_tool_m": (0.0, 0.0)}, "centre_tool_m: x, y and z"),
        ({"centre_tool_m": "abc"}, "centre_tool_m: x, y and z"),
        ({"centre_tool_m": (0.0, 0.0, "z")}, "centre_tool_m: not a number"),
        ({"friction": "a"}, "friction: not a number"),
        ({"friction": None}, "friction: not a number"),
        ({"friction": float("nan")}, "^of the held tool: friction must be in"),
        ({"stiffness_Nm_rad": 1e9}, "^of the held tool: stiffness_Nm_rad must be in"),
    ],
)
def test_bad_settings_are_told(plate: Scene, setting: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        World(plate, ReplayOptions(couple=CoupleOptions(**setting)))


def test_centre_may_be_an_array_and_depth_is_measured_there(plate: Scene) -> None:
    centre: Any = np.array([0.0, 0.0, 0.03])
    options = ReplayOptions(K_T, couple=CoupleOptions(centre_tool_m=centre))
    rows = run_path(plate, stroke(Rotation.from_rotvec([0.3, 0.2, 0.0]), 1.0), options)
    pressed = rows[rows["areas"] > 0]
    assert len(pressed) > 5
    force_N = np.linalg.norm(pressed["force_N"], axis=1)
    assert pressed["depth_m"] == pytest.approx(force_N / K_T, rel=1e-4, abs=1e-7)
    assert (rows["depth_m"][rows["areas"] == 0] == 0.0).all()


def test_default_of_the_spring_is_that_of_c() -> None:
    config, ours = lib.cr_couple_config_default(), CoupleOptions()
    assert config.stiffness_Nm_rad == ours.stiffness_Nm_rad
    assert config.friction == ours.friction


@pytest.mark.parametrize("turn_deg", [0.0, 37.0])
def test_a_ball_is_held_by_a_corner(turn_deg: float) -> None:
    """Its samples face away from each of the three planes there: left out for that, a ball of R 15 mm sank 2.5 mm into
    the corner and nothing was felt. What is left is the tip between four samples.
    """
    block = mf.Manifold.cube([40.0, 40.0, 40.0]).translate([-40.0, -40.0, -40.0])
    scene = scene_of(block, mf.Manifold.sphere(15.0, 64), 1e-3, 1e-3)
    out_of = np.ones(3) / np.sqrt(3.0)
    deep_mm = np.concatenate([np.linspace(-1.0, 3.0, 400), np.full(50, 3.0)])
    rows = np.zeros((len(deep_mm), 8))
    rows[:, 0] = 1e-3 * np.arange(len(rows))
    rows[:, 1:4] = 1e-3 * (15.0 - deep_mm)[:, None] * out_of
    x, y, z, w = Rotation.from_rotvec(np.radians(turn_deg) * np.array([0.0, 0.6, 0.8])).as_quat()
    rows[:, 4:8] = w, x, y, z
    ticks = run_path(
        scene,
        Trajectory(rows, "corner"),
        ReplayOptions(stiffness_N_m=1000.0, couple=CoupleOptions()),
    )
    held_mm = 15.0 - 1e3 * (ticks["display_pos_m"].astype(np.float64) @ out_of)
    assert held_mm.max() < 0.6
    felt_mm = ticks["force_N"].astype(np.float64) @ out_of
    assert felt_mm[-1] > 2.4
